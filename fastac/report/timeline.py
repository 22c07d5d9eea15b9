"""When each stage of the hardware gives its results for one frame, from the stages' shares of the latency."""

from collections.abc import Mapping
from dataclasses import dataclass

from fastac.scenes.pace import Pace
from fastac.scenes.schema import Scene

RESULTS = ("force", "dots", "slip")
"""Stages that give one result a frame, at the end."""
WHOLE_FRAME = ("to_columns", "reversal")
"""Stages that hold nearly a frame before they give it on, then without a pause."""
PIXELS = "pixels in"


@dataclass(frozen=True)
class StageTime:
    """One stage: what it adds to the time of a frame, and when it gives its first and its last output.

    All in clock cycles; `first` and `last` count from the frame's first pixel. `module` is that of the
    paper's three of which the stage is a part ("normals", "depth" or "force"), or "input".
    """

    name: str
    module: str
    adds: int
    first: int
    last: int

    @property
    def label(self) -> str:
        return self.name.replace("_", " ")


def of_scene(scene: Scene, latency: Mapping[str, dict]) -> list[StageTime]:
    """`of_image` for a scene's images; latency : `latency_cycles_by_formula` of report.json."""
    sensor = scene.sensor
    beside = latency.get("force_stage", {})
    return of_image(latency["stage"], sensor.height_px, sensor.width_px, scene.pace, beside)


def of_image(
    stages: Mapping[str, int],
    height_px: int,
    width_px: int,
    pace: Pace,
    beside: Mapping[str, int] | None = None,
) -> list[StageTime]:
    """The stages in order, before them the pixels themselves.

    beside : `latency_cycles_by_formula.force_stage` of report.json, where the force does not wait for the
        depth: its own stages follow behind the slopes
    stages : `latency_cycles_by_formula.stage` of report.json. With a solver, what stands before it are times
        from first output to first output, and from the solver on from last output to last output; without
        one, the first entry reaches to the last output.

    Outputs come as fast as the pixels up to the solver, there row by row as the rows come in, and behind the
    stages that hold a frame at the same pace without the pauses between rows.
    """
    size = width_px - 2
    lanes, fold = pace.lanes, pace.fold
    beats = -(-size // lanes)
    image = (height_px * width_px // lanes - 1) * fold
    rows = ((size - 1) * (width_px // lanes) + beats - 1) * fold
    frame = (size * beats - 1) * fold
    with_solver = "source" in stages
    found, now, spread, before_solver = [StageTime(PIXELS, "input", 0, 0, image)], 0, image, with_solver
    for name, adds in stages.items():
        if name == "source":
            found += _of_force(beside or {}, now + spread)
            before_solver, spread = False, rows
        now += adds
        if name in WHOLE_FRAME:
            spread = frame
        elif name in RESULTS:
            spread = 0
        first = now if before_solver else max(now - spread, 0)
        last = now + spread if before_solver else now
        found.append(StageTime(name, _module(name, with_solver), adds, first, last))
    return found


def _of_force(stages: Mapping[str, int], slopes_end: int) -> list[StageTime]:
    """Those of a force that does not wait for the depth; slopes_end : when the last slopes are there."""
    found, now = [], slopes_end
    for name in (name for name in stages if name in RESULTS):
        now += stages[name]
        found.append(StageTime(name, "force", stages[name], now, now))
    return found


def _module(name: str, with_solver: bool) -> str:
    if name == "normals":
        return "normals"
    return "depth" if with_solver and name not in RESULTS else "force"


def modules(stages: list[StageTime]) -> dict[str, int]:
    """What each module adds to the time until the result, in cycles; the sum is that time, but for a force
    beside the depth, which adds nothing to the depth's."""
    found: dict[str, int] = {}
    for stage in stages:
        if stage.module != "input":
            found[stage.module] = found.get(stage.module, 0) + stage.adds
    return found
