"""Designs of a sweep that differ in the training's seed alone: means, spreads, and what a network costs."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fastac.report.tables import Table, number
from fastac.sweep.front import Source
from fastac.sweep.results import Row
from fastac.sweep.shown import SHOWN, named

SEED = "training.seed"
COMPARED = ("normal_mae_deg", "depth_mae_mm", "force_mae_n")
"""Errors whose means are shown; of the force that of all its axes together, which chance moves least."""
HEADLINES = (*COMPARED[:2], "force_x_mae_n", "force_y_mae_n", "force_z_mae_n")
"""Errors that are shown of floats and integers, the force's axis by axis."""
FEWEST = 2
"""Seeds of a design that has a spread."""


@dataclass(frozen=True)
class Trainings:
    """The rows of one design, a row for each seed."""

    rows: Sequence[Row]

    @property
    def design(self) -> Row:
        """The first row, without the seed among its axes."""
        first = self.rows[0]
        return replace(first, axes={key: value for key, value in first.axes.items() if key != SEED})

    def has(self, name: str) -> bool:
        return all(name in row.metrics for row in self.rows)

    def mean(self, name: str) -> float:
        return float(np.mean([row.metrics[name] for row in self.rows]))

    def furthest(self, name: str) -> float:
        """How far the training furthest from the mean is from it, in percent of the mean."""
        values = np.array([row.metrics[name] for row in self.rows])
        return float(100 * np.abs(values / values.mean() - 1).max())

    def spread(self, name: str) -> float:
        """Standard deviation, as of a sample."""
        return float(np.std([row.metrics[name] for row in self.rows], ddof=1))


def trainings(rows: Iterable[Row]) -> list[Trainings]:
    """The designs with several seeds, in the order in which they were measured first."""
    found: dict[str, dict[int, Row]] = {}
    for row in rows:
        found.setdefault(_without(row, ()), {})[row.scene["training"]["seed"]] = row
    return [Trainings([*by_seed.values()]) for by_seed in found.values() if len(by_seed) >= FEWEST]


def _without(row: Row, tables: Sequence[str]) -> str:
    """The row's scene without name, seed and simulation, and without `tables`, to group rows by."""
    kept = {key: value for key, value in row.scene.items() if key not in ("name", "simulation", *tables)}
    training = {key: value for key, value in kept["training"].items() if key != "seed"}
    return json.dumps(kept | {"training": training}, sort_keys=True)


def seeds_table(source: Source) -> Table:
    """Means and standard deviations over training.seed, and the change from the design's first network."""
    designs = trainings(source.done)
    errors = [name for name in COMPARED if any(design.has(name) for design in designs)]
    costs = [name for name in SHOWN if any(design.has(name) for design in designs)]
    first: dict[str, Trainings] = {}
    rows = []
    for design in designs:
        reference = first.setdefault(_without(design.rows[0], ("network",)), design)
        cells = [_mean(design, name) + _change(design, reference, name) for name in errors]
        cells += [_mean(design, name) for name in costs]
        rows.append([named(design.design) or design.design.scene["name"], len(design.rows), *cells])
    return Table(
        f"Means over {SEED}: {source.results.path.name}",
        ["design", "trainings", *errors, *costs],
        [[str(cell) for cell in row] for row in rows],
        "Mean ± standard deviation over trainings; in brackets the mean's change from the first line of a"
        " scene with another network.",
    )


def headlines_table(source: Source) -> Table:
    """Each error of floats and integers as mean and spread over training.seed, and how far one training may
    be from the mean."""
    rows = []
    for design in trainings(source.done):
        label = named(design.design) or design.design.scene["name"]
        for name in HEADLINES:
            floats = f"float_{name}"
            if not (design.has(name) and design.has(floats)):
                continue
            loss = 100 * (design.mean(name) / design.mean(floats) - 1)
            found = [part for key in (floats, name) for part in (_mean(design, key), _furthest(design, key))]
            share = _mean(design, name.replace("mae_n", "nmae_percent")) if name.startswith("force") else ""
            rows.append([label, str(len(design.rows)), name, *found, f"{loss:+.1f}%", share])
    return Table(
        f"Errors over {SEED}: {source.results.path.name}",
        ["design", "trainings", "error", "float", "furthest", "integer", "furthest", "loss", "% of load"],
        rows,
        "Mean ± standard deviation over trainings; furthest: of the training furthest from the mean; loss: of"
        " the integers' mean against the floats'; % of load: the integers' error in percent of the largest"
        " load along its axis.",
    )


def _furthest(design: Trainings, name: str) -> str:
    return f"{design.furthest(name):.1f}%"


def _mean(design: Trainings, name: str) -> str:
    if not design.has(name):
        return ""
    mean, spread = design.mean(name), design.spread(name)
    if not spread:
        return number(mean)
    digits = ",.0f" if mean >= 1000 else ",.3g" if spread > mean / 100 else ",.4g"
    return f"{mean:{digits}} ± {spread:{',.0f' if mean >= 1000 else '.2g'}}"


def _change(design: Trainings, reference: Trainings, name: str) -> str:
    if design is reference or not (design.has(name) and reference.has(name)):
        return ""
    return f" ({100 * (design.mean(name) / reference.mean(name) - 1):+.1f}%)"
