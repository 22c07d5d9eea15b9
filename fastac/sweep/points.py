"""A sweep's points as steps: a training runs once for all points that share it, then each is measured.

fastac/sweep/results.py stores what was measured.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fastac.flow import steps as build_steps
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.closure import Closure
from fastac.store.digest import path_digest
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.sweep import point_steps
from fastac.sweep.spec import digest

FUNCTIONS = (
    *(build_steps.data, build_steps.normals, build_steps.integers),
    *(point_steps.force_start, point_steps.float_errors, point_steps.measure),
)
"""The functions of all steps behind a point."""


@dataclass(frozen=True)
class Setting:
    """What all points of a sweep have in common: the store's folder, the data, the frames evaluated."""

    store: str
    data: str | None
    split: str
    frames: int


@dataclass(frozen=True)
class PointModels:
    """The steps of one scene, and what they found."""

    scene: Scene
    setting: Setting

    @cached_property
    def shared(self) -> dict[str, Step]:
        """Trainings that points may share, by name, each after those that it needs."""
        scene, store = self.scene, {"store": Path(self.setting.store)}
        quiet, found = store | {"progress": False}, {}
        data = self.setting.data and Path(self.setting.data)
        if data is None:
            # With everything that any point might want, drags included where friction carries them: they all
            # learn from the same presses.
            wanted = ("depth", "force_xyz") if scene.sensor.elastomer.friction else ("depth",)
            pressed = {"scene": scene.model_copy(update={"outputs": wanted})}
            found["data"] = Step("data", build_steps.data, pressed, (build_steps.DATA,), quiet)
            data = found["data"].output(build_steps.DATA)
        known = {"scene": scene, "data": data}
        found["normals"] = Step("normals", build_steps.normals, known, (build_steps.NORMALS,), quiet)
        weights = known | {"weights": found["normals"].output(build_steps.NORMALS)}
        found["integers"] = Step("integers", build_steps.integers, weights, (build_steps.INTEGERS,), quiet)
        force = None
        if scene.wants_force:
            start = Step("force_start", point_steps.force_start, weights, (point_steps.START_FILE,), store)
            found["force_start"], force = start, start.output(point_steps.START_FILE)
        judged = weights | {"force": force} | self._evaluated
        float_file = (point_steps.FLOAT_FILE,)
        found["float_errors"] = Step("float_errors", point_steps.float_errors, judged, float_file, store)
        return found

    @cached_property
    def point(self) -> Step:
        """The step that measures the point; its value are the metrics."""
        force = self.shared["force_start"].output(point_steps.START_FILE) if self.scene.wants_force else None
        given = {
            "scene": self.scene,
            "data": self.shared["normals"].arguments["data"],
            "integers": self.shared["integers"].output(build_steps.INTEGERS),
            "force": force,
            "floats": self.shared["float_errors"].output(point_steps.FLOAT_FILE),
        }
        store = {"store": Path(self.setting.store)}
        return Step("point", point_steps.measure, given | self._evaluated, (), store)

    @property
    def _evaluated(self) -> dict:
        return {"split": self.setting.split, "count": self.setting.frames}

    def path(self, name: str, output: str) -> Path:
        """What a shared step wrote; it is performed if it has not been."""
        return open_store(Path(self.setting.store)).perform(self.shared[name]).path(output)

    @property
    def data_path(self) -> Path:
        return Path(self.setting.data) if self.setting.data else self.path("data", build_steps.DATA)

    @cached_property
    def data(self) -> Dataset:
        return build_steps.training_data(self.data_path, self.scene, Path(self.setting.store))

    @cached_property
    def index(self) -> np.ndarray:
        """The frames that are evaluated."""
        return point_steps.evaluated(self.data, self.setting.split, self.setting.frames, self.data_path)

    @property
    def _force_path(self) -> Path | None:
        return self.path("force_start", point_steps.START_FILE) if self.scene.wants_force else None

    @cached_property
    def pipeline(self) -> IntegerPipeline:
        """The integers, as `fastac train` would find them."""
        integers = self.path("integers", build_steps.INTEGERS)
        return point_steps.integer_model(self.data, self.scene, integers, self._force_path)

    @cached_property
    def floats(self) -> dict[str, np.ndarray]:
        """The float models' arrays, for a bundle."""
        return point_steps.float_arrays(self.path("normals", build_steps.NORMALS), self._force_path)


def point_code(store: Path) -> dict[str, Closure]:
    """All code that a point can depend on: its steps', the schema's and every kind that a scene can choose.

    It is found in the source, so that all processes with the same source agree.
    """
    code = open_store(store).code
    code.refresh()
    return code.all_kinds(f"{start.__module__}:{start.__qualname__}" for start in (*FUNCTIONS, Scene))


def code_digest(store: Path) -> str:
    found = point_code(store)
    return digest([found[start].digest for start in sorted(found)])


def generation(setting: Setting) -> str:
    """What all comparable points share: the code, the data, the frames."""
    return digest([code_digest(Path(setting.store)), *_evaluated_on(setting)])


def point_key(content: dict, setting: Setting) -> str:
    """Of a point: what it is, and on which data and frames it is judged."""
    return digest([content, *_evaluated_on(setting)])


def _evaluated_on(setting: Setting) -> tuple[str | None, str, int]:
    data = None if setting.data is None else path_digest(Path(setting.data))
    return data, setting.split, setting.frames
