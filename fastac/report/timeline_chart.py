"""The stages of the hardware as a timeline: on a page, and on an axis of Matplotlib."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.ticker import MaxNLocator

from fastac.report.timeline import StageTime

COLOURS = {"input": "#8c97a3", "normals": "#3f83c5", "depth": "#8a63c0", "force": "#d9792a"}
"""Of a stage's module; `style.css.j2` has the same."""
ROOM = 30
"""Percent of the timeline that the text beside or in a bar needs."""


@dataclass(frozen=True)
class Tick:
    """A number below the timeline; `side` tells the page how to align it: "start", "" or "end"."""

    percent: float
    label: str

    @property
    def side(self) -> str:
        return "start" if self.percent < 2 else "end" if self.percent > 94 else ""


@dataclass(frozen=True)
class Row:
    """A stage's line on a page: its bars in percent of their columns."""

    stage: StageTime
    adds_percent: float
    left_percent: float
    width_percent: float

    label = property(lambda self: self.stage.label)
    module = property(lambda self: self.stage.module)
    adds = property(lambda self: self.stage.adds)
    first = property(lambda self: self.stage.first)
    last = property(lambda self: self.stage.last)

    @property
    def when(self) -> str:
        return f"{self.last:,}" if self.first == self.last else f"{self.first:,} – {self.last:,}"

    @property
    def text_class(self) -> str:
        return "inside" if self.width_percent > ROOM else ""

    @property
    def text_at(self) -> str:
        """Where the text stands: in a long bar, else behind it, or before it where there is no room."""
        end = self.left_percent + self.width_percent
        if self.text_class:
            return f"left: calc({self.left_percent}% + 6px)"
        if end + ROOM <= 100:
            return f"left: calc({end:.2f}% + 8px)"
        return f"right: calc({100 - self.left_percent:.2f}% + 6px)"


@dataclass(frozen=True)
class Chart:
    """Rows and ticks of a timeline on a page."""

    rows: Sequence[Row]
    ticks: Sequence[Tick]


def chart(stages: Sequence[StageTime], end: int | None = None) -> Chart:
    """The timeline for a page; the column of what stages add has a logarithmic scale.

    end : last clock cycle shown; None: the last output's
    """
    end = max(end or max(stage.last for stage in stages), 1)
    most = math.log1p(max(max(stage.adds for stage in stages), 1))
    rows = [
        Row(
            stage,
            round(100 * math.log1p(stage.adds) / most, 2),
            round(100 * stage.first / end, 2),
            round(100 * (stage.last - stage.first) / end, 2),
        )
        for stage in stages
    ]
    ticks = [Tick(round(100 * at / end, 2), f"{at:,.0f}") for at in _ticks(end)]
    return Chart(rows, ticks)


def _ticks(end: int) -> list[float]:
    return [at for at in MaxNLocator(5, integer=True).tick_values(0, end) if 0 <= at <= end]


def draw(axis, stages: Sequence[StageTime]) -> None:
    """The timeline on a Matplotlib axis: a bar from each stage's first to its last output, with numbers."""
    end = max(stage.last for stage in stages)
    for k, stage in enumerate(stages):
        width = max(stage.last - stage.first, 0.004 * end)
        axis.barh(k, width, left=stage.last - width, color=COLOURS[stage.module], height=0.75)
        text = f"{stage.first:,} – {stage.last:,}" if stage.first != stage.last else f"{stage.last:,}"
        fits = width > 0.12 * end
        at, side, ink = (stage.first + 0.005 * end, "left", "white") if fits else (None, None, "black")
        if not fits:
            ahead = stage.last < 0.88 * end
            at = stage.last + 0.005 * end if ahead else stage.last - width - 0.005 * end
            side = "left" if ahead else "right"
        axis.text(at, k, text, fontsize=7, ha=side, va="center", color=ink)
    axis.set_yticks(range(len(stages)), [_named(stage) for stage in stages], fontsize=8)
    axis.set_ylim(len(stages) - 0.5, -0.5)
    axis.set_xlim(0, end)
    axis.xaxis.set_major_formatter("{x:,.0f}")
    axis.set_xlabel("clock cycles from the first pixel")
    axis.grid(axis="x", alpha=0.3)
    axis.set_axisbelow(True)


def _named(stage: StageTime) -> str:
    return f"{stage.label}: +{stage.adds:,}" if stage.adds else stage.label
