"""Experiments on what limits the force: HyperForce in closed form on other displacements and other loads.

Closed form: random hidden layers, the last one by ridge regression, its strength by the validation split. It
takes seconds, and all experiments take the same; what AdamW adds is in the ablation.
"""

from pathlib import Path

import numpy as np
import torch

from fastac.flow import frames
from fastac.models.accuracy import with_background_of
from fastac.models.floating.hyperforce import coordinates
from fastac.models.floating.hyperforce_3d import HyperForce3D
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import bundle as bundles
from fastac.models.training.force.hyperforce_3d import input_components, refit_last_layer
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor import dataset
from fastac.sensor.dataset import SPLITS, Dataset
from fastac.store.files import load_arrays
from fastac.store.steps import Output, Step
from fastac.store.store import open_store
from fastac.studies.reproduce import displacements, force_ablation
from fastac.studies.reproduce.displacements import FILE, Fields
from fastac.studies.reproduce.limits_geometry import NOISELESS, seen_by, variants
from fastac.studies.reproduce.section import Finished, one_ball


def closed_form(scene: Scene, rest_depth_mm: np.ndarray, parts: Fields) -> dict[str, list[float]]:
    """Errors of each component on the test split, see `force_ablation.errors`."""
    fields, forces = parts
    torch.manual_seed(scene.training.seed)
    model = HyperForce3D(
        coordinates(rest_depth_mm[1:-1, 1:-1]),
        kernel_size=scene.force.kernel_size,
        hidden=scene.force.hidden,
        axes=3,
    )
    x = {split: input_components(scene, fields[split], "xyz") for split in ("train", "validation")}
    model.set_force_unit(x["train"], torch.from_numpy(forces["train"].astype(np.float32)))
    fitted = refit_last_layer(model, x, {split: forces[split] for split in x})
    found_n = fitted(input_components(scene, fields["test"], "xyz")).detach().double().numpy()
    return force_ablation.errors(found_n, forces["test"])


def seen(true: Fields, kept: dict[str, np.ndarray]) -> Fields:
    """Those of the frames (bool, by split) whose dots were all found."""
    return tuple({split: part[split][kept[split]] for split in SPLITS} for part in true)


def mixed(tangential: Fields, normal: Fields) -> Fields:
    """d_x and d_y of the one, d_z of the other, of the same frames."""
    pairs = {split: (tangential[0][split][:, :2], normal[0][split][:, 2:]) for split in SPLITS}
    return {split: np.concatenate(pair, axis=1) for split, pair in pairs.items()}, normal[1]


def smaller_loads(data: Dataset, parts: Fields) -> Fields | None:
    """All but the presses of the protocol's largest load, where contact is least linear.

    None where the dataset does not say which they are, or F_z would not vary among the others.
    """
    if data.indenter is None or "load_n" not in data.indenter:
        return None
    load_n = data.indenter["load_n"]
    if len(np.unique(load_n)) < 3:
        return None
    chosen = {split: load_n[one_ball(data, split)] < load_n.max() for split in SPLITS}
    return tuple({split: part[split][chosen[split]] for split in SPLITS} for part in parts)


def write_noiseless(
    folder: Path, scene: Scene, sensor: Sensor, bundle: Path, data: Path, *, store: Path, progress: bool
) -> None:
    """A step: what a bundle's float pipeline and the dots show where `sensor` is a camera without noise."""
    known = frames.read(data, scene, store=store, progress=progress)
    label = f"frames, {NOISELESS}"
    still = seen_by(sensor, known, scene.protocol.seed, label=label, progress=progress)
    pipeline = with_background_of(FloatPipeline.from_bundle(bundles.load_for(bundle, scene)), still)
    arrays = displacements.find_arrays(pipeline, still, progress=progress)
    displacements.save(folder / FILE, arrays, still)


def judge(folder: Path, scene: Scene, tangential: Path, normal: Path, data: Path | None) -> dict | None:
    """A step: errors in closed form with d_x and d_y of one file of displacements and d_z of another.

    data : the dataset of both, whose largest load is left out; None leaves out none
    Only frames that both files have count. None where nothing can be left out.
    """
    files = [load_arrays(path) for path in (tangential, normal)]
    both = {
        split: np.logical_and(*(displacements.kept(arrays)[split] for arrays in files)) for split in SPLITS
    }
    parts = mixed(*(_of_frames(arrays, both) for arrays in files))
    if data is not None:
        parts = smaller_loads(dataset.read(data, scene), parts)
    rest_mm = files[0]["rest_depth_mm"].astype(np.float64)
    return None if parts is None else closed_form(scene, rest_mm, parts)


def _of_frames(arrays: dict[str, np.ndarray], chosen: dict[str, np.ndarray]) -> Fields:
    """Of a file's arrays the frames chosen, bool over the whole splits."""
    kept = displacements.kept(arrays)
    return seen(displacements.fields(arrays), {split: chosen[split][kept[split]] for split in SPLITS})


def experiment_steps(build: Finished) -> dict[str, Step]:
    """By experiment; where the sensor has no noise, none is without."""
    scene, data, quiet = build.scene, build.data_path, {"store": build.store, "progress": build.progress}
    true = displacements.true_step(scene, data).output(FILE)
    found = displacements.found_step(scene, data, bundle=build.bundle_path, **quiet).output(FILE)

    def step(tangential: Output, normal: Output, of: Scene = scene, loads: Path | None = None) -> Step:
        known = {"scene": of, "tangential": tangential, "normal": normal, "data": loads}
        return Step("limits-force", judge, known)

    steps = {
        "true displacements": step(true, true),
        "found displacements": step(found, found),
        "true d_x, d_y; found d_z": step(true, found),
        "found d_x, d_y; true d_z": step(found, true),
        "true, without the largest load": step(true, true, loads=data),
    }
    if scene.force.clamp:
        free = scene.model_copy(update={"force": scene.force.model_copy(update={"clamp": False})})
        steps["true, d_z not clamped"] = step(true, true, of=free)
        steps["found, d_z not clamped"] = step(found, found, of=free)
    still = variants(scene.sensor).get(NOISELESS)
    if still is not None:
        known = {"scene": scene, "sensor": still, "bundle": build.bundle_path, "data": data}
        seen_still = Step("displacements-noiseless", write_noiseless, known, (FILE,), quiet).output(FILE)
        steps["found in frames without camera noise"] = step(seen_still, seen_still)
    return steps


def experiments(build: Finished) -> dict[str, dict]:
    """Errors by experiment, those left out that the dataset does not allow for."""
    store = open_store(build.store)
    errors = {name: store.value(step) for name, step in experiment_steps(build).items()}
    return {name: found for name, found in errors.items() if found is not None}
