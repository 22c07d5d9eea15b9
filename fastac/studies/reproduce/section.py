"""A section of the reproduction: the step that finds its content, and the tables that show it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from fastac.flow import frames
from fastac.flow.build import Build
from fastac.models.integer import bundle as bundles
from fastac.models.integer.bundle import Bundle
from fastac.report.tables import Table
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset


@dataclass(frozen=True)
class Finished:
    """What a section reads of a finished build: its bundle and its dataset.

    store : folder of the step store
    """

    bundle: Bundle
    data: Dataset
    bundle_path: Path
    data_path: Path
    store: Path
    progress: bool

    @classmethod
    def read(cls, scene: Scene, bundle: Path, data: Path, *, store: Path, progress: bool) -> Self:
        model = bundles.load_for(bundle, scene)
        known = frames.read(data, scene, store=store, progress=progress)
        return cls(model, known, bundle, data, store, progress)

    @property
    def scene(self) -> Scene:
        return self.bundle.scene


Known = Build | Finished
"""Where a section may ask for `scene`, `data` and `data_path`, before or inside its step."""


@dataclass(frozen=True)
class Section:
    """One part of `reproduce.json` and of the page.

    run : a step's function, `run(folder, **results, store=..., progress=...)`; writes `<name>.json` and the
        pictures into the folder
    tables : of that JSON
    reads : the build's results that `run` is given: "scene", "bundle", "data" or "report"
    needs : names of sections before it whose JSON `run` is given
    pictures : file names, PNG, in the order in which the page shows them above the tables
    others : further files that `run` writes
    lacks : the one line that says why it cannot be run on this build; None if it can
    """

    title: str
    run: Callable[..., None]
    tables: Callable[[dict], list[Table]]
    pictures: tuple[str, ...]
    reads: tuple[str, ...] = ("scene", "bundle", "data")
    needs: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    lacks: Callable[[Build], str | None] = lambda _: None


def vertical(data: Dataset, split: str) -> np.ndarray:
    """Samples of a split that were not dragged: those that the paper judges geometry by."""
    index = data.indices(split)
    if data.indenter is None or "tangential_x_n" not in data.indenter:
        return index
    dragged = np.hypot(data.indenter["tangential_x_n"], data.indenter["tangential_y_n"])
    return index[dragged[index] == 0]


def one_ball(data: Dataset, split: str) -> np.ndarray:
    """Samples of a split pressed by the ball of the test presses: the paper's protocol has one ball, and a
    scene may train on others too."""
    index = data.indices(split)
    if data.indenter is None or "ball_mm" not in data.indenter:
        return index
    ball_mm = data.indenter["ball_mm"]
    return index[np.isin(ball_mm[index], ball_mm[data.indices("test")])]


def beside(ours: float, paper: float | None, digits: int = 4) -> list[str]:
    """Two cells: ours and the paper's."""
    return [f"{ours:.{digits}f}", "" if paper is None else f"{paper:.{digits}f}"]
