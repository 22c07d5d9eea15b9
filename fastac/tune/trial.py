"""One training that is compared with others: without some units, and its errors on them; kept as a step."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from fastac.flow import force_training, frames, leave_one_out, training
from fastac.flow.pipelines import float_pipeline
from fastac.models import accuracy
from fastac.models.floating.pipeline import FloatPipeline
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.importers.force_labels import split_by_group
from fastac.store.files import load_arrays
from fastac.store.recording import unrecorded
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.sweep.pools import single_threaded
from fastac.tune.groups import units_of

NORMALS = "normals.npz"
METRICS = (
    *("contact_gradient_angle_mae_rad", "normal_mae_deg"),
    *("contact_depth_mae_mm", "depth_mae_mm", "force_mae_n"),
)
"""Errors that models can be chosen by; of the skin's direction and of the depth the first that there is."""
KINDS = (METRICS[:2], METRICS[2:4], METRICS[4:])


@dataclass(frozen=True)
class Source:
    """The data of all trials, the same in every process.

    by : as in `units_of`; with_test : whether the frames of the split test may be learned from
    """

    data: Path
    store: Path
    by: str | None
    with_test: bool

    def read(self, scene: Scene) -> tuple[Dataset, np.ndarray]:
        """The dataset, and the unit of each frame, "" for those of the split test that stay aside."""
        data = frames.read(self.data, scene, store=self.store)
        units = units_of(data, self.by)
        return data, units if self.with_test else np.where(data.split == "test", "", units)


def without(source: Source, scene: Scene, held_out: list[str]) -> tuple[Dataset, np.ndarray]:
    """The dataset to train on without some units, and the unit of each frame.

    The frames of other units are in the splits train and validation: as the dataset has them or, in trainings
    from forces, validation takes stretches of each unit, as an import would.
    """
    data, units = source.read(scene)
    if scene.training.labels == "force":
        split = split_by_group(units, ())
    else:
        split = np.where(data.split == "validation", "validation", "train").astype("U10")
    aside = np.isin(units, held_out) | ((data.split == "test") & (units == ""))
    return replace(data, split=np.where(aside, "", split)), units


def network(folder: Path, scene: Scene, held_out: list[str], **source) -> None:
    """A step: the float pixel network of a scene, trained without the units `held_out`."""
    known, _ = without(Source(**source), scene, held_out)
    aside = np.where(known.split == "", "test", known.split)
    training.require(replace(known, split=aside), scene.unwatched(), source["data"])
    training.normals(known, scene, folder / NORMALS, progress=False)


def errors(folder: Path, scene: Scene, held_out: list[str], weights: Path, **source) -> dict:
    """A step: the errors of the float models by held-out unit, {unit: {metric: error}}."""
    known, units = without(Source(**source), scene, held_out)
    arrays = load_arrays(weights)
    if scene.wants_force:
        arrays |= force_training.start_force(known, scene, arrays, progress=False)[1]
    pipeline = float_pipeline(arrays, known, scene)
    return {name: judged(pipeline, known, np.flatnonzero(units == name), scene) for name in held_out}


def judged(pipeline: FloatPipeline, data: Dataset, index: np.ndarray, scene: Scene) -> dict[str, float]:
    """The errors among METRICS on the frames `index`: one of each kind that is known and wanted, so that of
    models whose outputs are forces alone only the force counts."""
    result, rest = pipeline.run(data.frames[index]), pipeline.run(data.background[None])
    found = accuracy.evaluate(result, rest, data, index, scene)
    kinds = KINDS if scene.wants_geometry else KINDS[2:]
    names = (next((name for name in kind if name in found), None) for kind in kinds)
    return {name: found[name] for name in names if name is not None}


def tested(folder: Path, scene: Scene, **source) -> dict:
    """A step: the errors of floats and integers on the split test, of a training on everything else."""
    known, _ = Source(**source).read(scene)
    model = leave_one_out.train(known, scene, folder, progress=False)
    found, _ = accuracy.compare_pipelines(model, known, known.indices("test"), progress=False)
    return {
        name: {key: value for key, value in found[name].items() if key in METRICS}
        for name in ("float", "integer")
    }


def step_of(scene: Scene, source: Source, held_out: list[str] | None) -> Step:
    """The step of a trial, which needs that of its network; without `held_out`: `tested`.

    Intervals around forces, which cost trainings of their own, have no part in the comparison.
    """
    scene = leave_one_out.without_interval(scene)
    known = {"scene": scene, "data": source.data, "by": source.by, "with_test": source.with_test}
    store = {"store": source.store}
    if held_out is None:
        return Step("tuned_test", tested, known, (), store)
    apart = known | {"held_out": held_out}
    trained = Step("tuned_network", network, apart, (NORMALS,), store)
    return Step("tuned_errors", errors, apart | {"weights": trained.output(NORMALS)}, (), store)


def perform(scene: dict, source: Source, held_out: list[str] | None) -> dict:
    """What the step of a trial found, on one core; raises ValueError, one line, where nothing can be trained.

    A worker's task: the scene comes as JSON content.
    """
    single_threaded()
    torch.set_num_threads(1)
    step = step_of(Scene.model_validate(scene), source, held_out)
    with threadpool_limits(1), unrecorded():
        return open_store(source.store).value(step)
