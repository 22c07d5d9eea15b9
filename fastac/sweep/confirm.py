"""Confirmation of points on the Pareto front: simulates their Verilog and compares bits and cycles."""

import random
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from fastac.flow import hardware
from fastac.models.integer import bundle as bundles
from fastac.scenes.schema import Scene
from fastac.sensor import samples
from fastac.store.store import open_store
from fastac.sweep.front import Source, TradeError
from fastac.sweep.point_steps import cycles_of, latency
from fastac.sweep.points import PointModels, Setting, point_key
from fastac.sweep.results import Row
from fastac.sweep.spec import Point

FRAMES = 3
"""Simulated back to back; three show the initiation interval twice."""


@dataclass(frozen=True)
class Confirmation:
    """Result of simulating a point's Verilog.

    cycles_counted : in the simulation; cycles_stated : by the cycle formulas that the sweep used
    """

    frames: int
    values_compared: int
    mismatches: int
    first_mismatch: str
    cycles_counted: dict[str, int]
    cycles_stated: dict[str, int]
    bundle_sha256: str

    @property
    def is_exact(self) -> bool:
        """Whether all values and all cycles agree."""
        return not self.mismatches and self.cycles_counted == self.cycles_stated


def choose(designs: Sequence[tuple[Source, Row]], count: int, seed: int) -> list[tuple[Source, Row]]:
    """`count` random designs, or all if there are fewer; the same for the same designs and seed."""
    ordered = sorted(designs, key=lambda pair: pair[1].key)
    return random.Random(seed).sample(ordered, min(count, len(ordered)))


def models_of(source: Source, row: Row) -> PointModels:
    """The models of a row. Raises TradeError where code or data have changed since they were measured."""
    setting = Setting(**source.facts["setting"])
    scene = Scene.model_validate(row.scene)
    models, store = PointModels(scene, setting), open_store(Path(setting.store))
    if point_key(Point({}, scene).content, setting) != row.key or not store.is_current(models.point):
        raise TradeError(f"{source.results.path}: sources or data have changed since: run fastac sweep again")
    return models


def confirm(source: Source, row: Row, folder: Path, *, progress: bool) -> Confirmation:
    """Write a row's bundle and Verilog into `folder` and simulate them on held-out frames.

    Raises TradeError where the row's metrics are not those of the present cycle formulas.
    """
    models = models_of(source, row)
    bundle = bundles.save(folder / "bundle", models.pipeline, models.floats)
    hardware.write_verilog(bundle, folder / "verilog", progress=progress)
    index = samples.evenly_spaced(models.index, FRAMES)
    found = hardware.simulate(
        bundle, models.data, index, folder / "verilog", folder / "sim", progress=progress
    )
    stated = cycles_of(models.pipeline)
    names = [name for name in found["latency_cycles"] if name in stated and name not in ("stage", "part")]
    summary = latency(models.pipeline)
    if any(row.metrics[name] != value for name, value in summary.items()):
        raise TradeError(f"point {row.key}: its cycles are no longer {row.metrics['latency_cycles']}")
    return Confirmation(
        found["frames"],
        found["values_compared"],
        found["mismatches"],
        found["first_mismatch"],
        {name: found["latency_cycles"][name] for name in names},
        {name: stated[name] for name in names},
        bundle.digest,
    )


def run(
    designs: Sequence[tuple[Source, Row]],
    count: int,
    seed: int,
    folder: Path,
    tell: Callable[[Row, dict], None],
    *,
    progress: bool,
) -> list[dict]:
    """Confirm `count` of the designs and record each in its results file; earlier confirmations are reused.

    tell : called with each row and its confirmation
    """
    found = []
    for source, row in choose(designs, count, seed):
        content = source.results.confirmations().get(row.key)
        if content is None:
            confirmation = confirm(source, row, folder / row.key, progress=progress)
            content = asdict(confirmation) | {"is_exact": confirmation.is_exact}
            source.results.confirm(row.key, content)
        tell(row, content)
        found.append(content)
    return found
