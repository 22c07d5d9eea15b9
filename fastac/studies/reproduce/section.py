"""A section of the reproduction: what it runs, what it shows, what it depends on."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.flow.build import Build
from fastac.report.tables import Table
from fastac.sensor.dataset import Dataset
from fastac.store.workspace import Workspace


@dataclass(frozen=True)
class Section:
    """One part of `reproduce.json` and of the page.

    name : its key, and its folder
    run : from a finished build and that folder to its content, JSON; pictures (PNG) that it leaves in the
        folder are shown below the tables
    tables : of that content
    sources : patterns of the source files that it depends on
    needs : names of the sections before it whose folders it reads
    lacks : the one line that says why it cannot be run on this build; None if it can
    of_hardware : whether it also depends on the Verilog's simulation
    """

    name: str
    title: str
    run: Callable[[Build, Path], dict]
    tables: Callable[[dict], list[Table]]
    sources: tuple[str, ...]
    needs: tuple[str, ...] = ()
    lacks: Callable[[Build], str | None] = lambda _: None
    of_hardware: bool = False

    @property
    def file(self) -> str:
        """Its content, in the folder of all."""
        return f"{self.name}/{self.name}.json"


def stamped_key(build: Build, step: str) -> str:
    """What identifies the result of a build's step: settings, code, and the same of the steps before it."""
    return Workspace(build.folder).stamped_key(step)


def vertical(data: Dataset, split: str) -> np.ndarray:
    """Samples of a split that were not dragged: those that the paper judges geometry by."""
    index = data.indices(split)
    if data.indenter is None or "tangential_x_n" not in data.indenter:
        return index
    dragged = np.hypot(data.indenter["tangential_x_n"], data.indenter["tangential_y_n"])
    return index[dragged[index] == 0]


def beside(ours: float, paper: float | None, digits: int = 4) -> list[str]:
    """Two cells: ours and the paper's."""
    return [f"{ours:.{digits}f}", "" if paper is None else f"{paper:.{digits}f}"]
