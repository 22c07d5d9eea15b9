"""The comparison of two builds as a page and as text."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fastac.report import differences, timeline
from fastac.report.differences import CYCLES, ENERGY, INTEGERS, RESOURCES, Difference, Finished
from fastac.report.render import render
from fastac.report.tables import Table, number
from fastac.report.timeline_chart import Chart, chart
from fastac.scenes.pace import pace_of
from fastac.store.files import write_text

SHOWN_FIRST = (
    *("first pixel to force", "first pixel to depth", "first pixel to normals", "initiation interval"),
    *("depth_mae_mm", "contact_depth_mae_mm", "normal_mae_deg", "force_nmae_percent", "force_z_nmae_percent"),
    *("dsp48e2", "dsp48e1", "lut", "ramb36", "estimated µJ a frame"),
)
"""Figures that stand at the top where both builds have them, in this order."""
MOST_FIRST = 8
LEAST_RANGE = math.log(2)
"""A bar that reaches the edge stands for a factor of at least this logarithm."""


@dataclass(frozen=True)
class Comparison:
    """Two finished builds, under the names that their columns have."""

    a: Finished
    b: Finished
    names: tuple[str, str]

    @property
    def figures(self) -> dict[str, list[Difference]]:
        return differences.figures(self.a, self.b)

    @property
    def tables(self) -> list[Table]:
        """What differs in the scenes, then all figures by section."""
        caution = differences.caution(self.a, self.b)
        head = ["figure", *self.names, f"{self.names[1]} against {self.names[0]}"]
        return [
            differences.scene_table(self.a, self.b, self.names),
            *(
                Table(title, head, [row.cells for row in rows], caution if title.startswith("Errors") else "")
                for title, rows in self.figures.items()
            ),
        ]

    @property
    def text(self) -> str:
        """All tables for a terminal; of the scenes only keys that differ are there."""
        parts = []
        for table in self.tables:
            parts.append(table.text if table.rows else table.title)
            if table.note:
                parts[-1] += f"\n  {table.note}"
        return "\n\n".join(parts)


@dataclass(frozen=True)
class Bar:
    """A figure's relative difference as a bar left (less) or right (more) of the middle, in percent."""

    figure: Difference
    left_percent: float
    width_percent: float

    @property
    def values(self) -> str:
        return f"{number(self.figure.a)} → {number(self.figure.b)}"


def read(folders: tuple[Path, Path]) -> Comparison:
    """The comparison of the builds in two folders; raises as `differences.read`."""
    a, b = (differences.read(folder) for folder in folders)
    names = (a.name, b.name) if a.name != b.name else (str(folders[0]), str(folders[1]))
    return Comparison(a, b, names)


def bars(figures: Sequence[Difference]) -> list[Bar]:
    """Bars of the figures that both builds have, with a common logarithmic scale of their ratios."""
    known = [each for each in figures if each.a and each.b and each.a > 0 and each.b > 0]
    logs = [math.log(each.b / each.a) for each in known]
    most = max([LEAST_RANGE, *map(abs, logs)])
    return [
        Bar(each, round(50 + 50 * min(log, 0) / most, 2), round(50 * abs(log) / most, 2))
        for each, log in zip(known, logs, strict=True)
    ]


def _timelines(shown: Comparison) -> list[tuple[str, Chart]]:
    """The stages of both builds on one scale of clock cycles."""
    found = []
    for build in (shown.a, shown.b):
        scene, latency = build.report["scene"], build.report["latency_cycles_by_formula"]
        size = scene["sensor"]["height_px"], scene["sensor"]["width_px"]
        pace = build.report.get("pace", scene["hardware"])["pixels_per_clock"]
        beside = latency.get("force_stage", {})
        found.append(timeline.of_image(latency["stage"], *size, pace_of(pace), beside))
    end = max(stage.last for stages in found for stage in stages)
    return [(name, chart(stages, end)) for name, stages in zip(shown.names, found, strict=True)]


def write(shown: Comparison, path: Path) -> None:
    """Write the page."""
    figures = shown.figures
    every = {
        each.name: each for title in (CYCLES, INTEGERS, RESOURCES, ENERGY) for each in figures.get(title, ())
    }
    first = [
        every[name] for name in SHOWN_FIRST if name in every and None not in (every[name].a, every[name].b)
    ]
    pictured = [
        (title, bars(figures[title])) for title in (CYCLES, INTEGERS, RESOURCES, ENERGY) if title in figures
    ]
    page = render(
        "report/comparison.html.j2",
        shown=shown,
        first=first[:MOST_FIRST],
        bars=[(title, found) for title, found in pictured if found],
        timelines=_timelines(shown),
        caution=differences.caution(shown.a, shown.b),
    )
    write_text(path, page)
