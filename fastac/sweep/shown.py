"""What the page and the pictures of a sweep show: its designs, the marked scenes, and the paper's figures."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from fastac.report.paper import EDGE
from fastac.sweep.front import ERRORS, Source
from fastac.sweep.results import Row

PAPER_CYCLES = EDGE["image_to_force_cycles_at_150_mhz"]
PAPER_ERRORS = {
    "depth_mae_mm": EDGE["integer"]["depth_mae_mm"],
    "force_z_mae_n": EDGE["integer"]["force_mae_n"],
}
PAPER_LABEL = "the paper: its own sensor and board"
SHOWN = ("latency_cycles", "dsp", "lut", "ramb36", "energy_uj")


@dataclass(frozen=True)
class Trade:
    """What is shown: the results files, their distinct points, and the marked scenes' rows by name."""

    sources: Sequence[Source]
    rows: Sequence[Row]
    marked: dict[str, Row] = field(default_factory=dict)

    @property
    def errors(self) -> list[str]:
        return [name for name in ERRORS if any(name in row.metrics for row in self.rows)]

    @property
    def confirmed(self) -> dict[str, dict]:
        found = {}
        for source in self.sources:
            found |= source.results.confirmations()
        return {row.key: found[row.key] for row in self.rows if row.key in found}


def named(row: Row) -> str:
    """The values chosen along the sweep's axes for a row, as text."""
    return ", ".join(f"{key.split('.')[-1]} {value_text(value)}" for key, value in row.axes.items())


def value_text(value) -> str:
    """A scene's value as text; the parts of a list with + between them."""
    return "+".join(map(str, value)) if isinstance(value, list) else str(value)
