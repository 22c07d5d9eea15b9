"""Speed of the software models on all cores: float pipeline, emulator, and the int64 reference loop.

    fastac bench models BUILD_FOLDER…

All frames at once, and one after another as from a camera: then all cores share each frame. The emulator must
equal the int64 loop on every value. The frames are random perturbations of the background and, where the
build folder has its dataset, frames of that.
"""

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from fastac.flow.frames import read
from fastac.models.emulator import direct
from fastac.models.emulator.exact import ExactTables
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.bundle import Bundle, load_bundle
from fastac.models.result import Result
from fastac.report.tables import text_table
from fastac.scenes.outputs import hardware_words, measured
from fastac.scenes.schema import Scene
from fastac.sensor.samples import evenly_spaced
from fastac.studies.benchmarks.timing import fastest, fastest_each

FRAMES, REPEATS = 64, 20
LOOP_FRAMES, LOOP_REPEATS = 8, 2
"""The same for the int64 loop, which takes ten times as long per frame."""


def benchmark_frames(bundle: Bundle, folder: Path) -> np.ndarray:
    """FRAMES frames (frames, H, W, C) uint8: an eighth is uniform noise; up to 3/8 come from the folder's
    dataset, if any; the others are the background with small noise."""
    background, rng = bundle.pipeline.background, np.random.default_rng(1)
    noise = background + rng.integers(-20, 21, (FRAMES, *background.shape))
    frames = np.clip(noise, 0, 255).astype(np.uint8)
    frames[::8] = rng.integers(0, 256, frames[::8].shape)
    if (folder / "data.h5").exists():
        data = read(folder / "data.h5", bundle.scene)
        chosen = data.frames[evenly_spaced(np.arange(len(data)), FRAMES * 3 // 8)]
        frames[1 : 1 + 2 * len(chosen) : 2][: len(chosen)] = chosen
    return frames


HEAD = ("model", "ms a frame", "frames/s", "processor ms", "one by one, ms", "frames/s", "times as long")


def cells(
    name: str, together: tuple[float, float], frames: int, single: tuple[float, float] | None = None
) -> list[str]:
    """A row of the table, from wall-clock and processor times of all `frames`: at once, and one by one."""
    wall_ms, processor_ms = (1e3 * value / frames for value in together)
    found = [name, f"{wall_ms:.2f}", f"{1e3 / wall_ms:.0f}", f"{processor_ms:.2f}"]
    if single is None:
        return [*found, "", "", ""]
    single_ms = 1e3 * single[0] / frames
    return [*found, f"{single_ms:.2f}", f"{1e3 / single_ms:.0f}", f"{single_ms / wall_ms:.2f}"]


def one_by_one(run: Callable, frames: np.ndarray) -> None:
    """Run each of `frames` by itself, as it would come from a camera."""
    for k in range(len(frames)):
        run(frames[k : k + 1])


def scene_outputs(scene: Scene) -> dict[str, tuple[str, ...]]:
    """The results that a scene wants, by model: names of the emulator's words and of the float pipeline's."""
    return {
        "emulator": ("validity", *hardware_words(scene.outputs)),
        "float pipeline": tuple(measured(scene.outputs)),
    }


def compare(found: Result, loop: dict[str, np.ndarray]) -> int:
    """The number of values compared with the loop's; raises ValueError where any differs."""
    for name, values in loop.items():
        different = int((getattr(found, name) != values).sum())
        if different:
            raise ValueError(f"{name}: {different} of {values.size} values differ from the int64 loop")
    return sum(values.size for values in loop.values())


def measure(folder: Path) -> Iterator[str]:
    """Time the models of a build folder and compare emulator and int64 loop; yields lines of text."""
    bundle = load_bundle(folder)
    pipeline, frames = bundle.pipeline, benchmark_frames(bundle, folder)
    models = {"float pipeline": FloatPipeline.from_bundle(bundle), "emulator": Emulator(pipeline)}
    ExactTables(pipeline)  # raises where the emulator would fall back on the int64 loop
    few, outputs = frames[:LOOP_FRAMES], direct.outputs(pipeline)
    loop = {name: np.empty((len(few), *shape), kind) for name, (shape, kind) in outputs.items()}
    yield f"{folder}, {' × '.join(map(str, pipeline.background.shape))}"
    rows = []
    for name, model in models.items():
        wanted = scene_outputs(bundle.scene)[name]
        for label, run in (
            ("all results", model.run),
            (", ".join(wanted), partial(model.run, wanted=wanted)),
        ):
            together, single = fastest_each([partial(run, frames), partial(one_by_one, run, frames)], REPEATS)
            rows.append(cells(f"{name}, {label}", together, FRAMES, single))
    seconds = fastest(partial(direct.loop, pipeline, few, loop), LOOP_REPEATS)
    rows.append(cells("int64 loop", seconds, LOOP_FRAMES))
    yield text_table(HEAD, rows)
    count = compare(Emulator(pipeline).run(few), loop)
    yield f"emulator = int64 loop: {count:,} of {count:,} values, all outputs of {LOOP_FRAMES} frames"


def heading() -> str:
    """The line above all results."""
    return f"For each frame, the fastest of {REPEATS} runs over {FRAMES} frames on {os.cpu_count()} cores:"
