"""Experiments on what limits the force: HyperForce in closed form on other displacements and other loads.

Closed form: random hidden layers, the last one by ridge regression, its strength by the validation split. It
takes seconds, and all experiments take the same; what AdamW adds is in the ablation.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from fastac.flow import training
from fastac.flow.build import Build
from fastac.flow.settings import float_settings
from fastac.models.accuracy import with_background_of
from fastac.models.floating.hyperforce import coordinates
from fastac.models.floating.hyperforce_3d import HyperForce3D
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.training.hyperforce_3d import input_components, refit_last_layer
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import SPLITS, Dataset
from fastac.store.files import content_hash, load_arrays, read_or_make
from fastac.store.sources import digest_sources
from fastac.studies.reproduce import force_ablation
from fastac.studies.reproduce.force_ablation import Fields
from fastac.studies.reproduce.limits_geometry import NOISELESS, seen_by, variants
from fastac.studies.reproduce.section import stamped_key

SOURCES = (
    "models/**/*.py",
    "sensor/**/*.py",
    "fastac/flow/frames.py",
    "fastac/studies/reproduce/force_ablation.py",
    "fastac/studies/reproduce/limits_*.py",
)


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
    chosen = {split: load_n[data.indices(split)] < load_n.max() for split in SPLITS}
    return tuple({split: part[split][chosen[split]] for split in SPLITS} for part in parts)


def noiseless(build: Build) -> Fields:
    """What the build's float pipeline and the dots show in frames without camera noise."""
    scene, data = build.scene, build.data
    sensor, label = variants(scene.sensor)[NOISELESS], f"frames, {NOISELESS}"
    still = seen_by(sensor, data, scene.protocol.seed, label=label, progress=build.progress)
    pipeline = with_background_of(FloatPipeline.from_bundle(build.bundle), still)
    arrays = force_ablation.find_arrays(pipeline, still, progress=build.progress)
    return force_ablation.found_fields(arrays, still)[0]


def run(build: Build, folder: Path, found_file: Path) -> dict[str, dict]:
    """Errors by experiment; `found_file` holds the displacements that the ablation found."""
    scene, data = build.scene, build.data
    rest_mm = training.rest_depth_mm(data)
    true = force_ablation.true_fields(data)
    arrays = load_arrays(found_file)
    found = force_ablation.found_fields(arrays, data)[0]
    kept = {split: arrays[f"{split}.kept"] for split in SPLITS}
    free = scene.model_copy(update={"force": scene.force.model_copy(update={"clamp": False})})
    experiments: dict[str, tuple[Scene, Callable[[], Fields | None]]] = {
        "true displacements": (scene, lambda: true),
        "found displacements": (scene, lambda: found),
        "true d_x, d_y; found d_z": (scene, lambda: mixed(seen(true, kept), found)),
        "found d_x, d_y; true d_z": (scene, lambda: mixed(found, seen(true, kept))),
        "true, without the largest load": (scene, lambda: smaller_loads(data, true)),
    }
    if scene.force.clamp:
        experiments["true, d_z not clamped"] = (free, lambda: true)
        experiments["found, d_z not clamped"] = (free, lambda: found)
    if NOISELESS in variants(scene.sensor):
        experiments["found in frames without camera noise"] = (scene, lambda: noiseless(build))
    base = [float_settings(scene), stamped_key(build, "normals"), digest_sources(SOURCES)]
    errors = {}
    for name, (of, parts_of) in experiments.items():
        slug = name.replace(",", "").replace(";", "").replace(" ", "-")

        def judged(of=of, parts_of=parts_of) -> dict | None:
            parts = parts_of()
            return None if parts is None else closed_form(of, rest_mm, parts)

        result = read_or_make(folder / f"force-{slug}-{content_hash(*base, name)}.json", judged)
        if result is not None:
            errors[name] = result
    return errors
