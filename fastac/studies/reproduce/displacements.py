"""Displacements of a dataset's presses along x, y and z, as steps of the store: true ones, and found ones.

A file holds for each split `.field_mm` (frames, 3, N, N) and `.force_n` (frames, 3) of the frames that are
`.kept`, bool over the split's frames of the protocol's own ball: frames whose markers were not all found are
left out. `rest_depth_mm` is
the skin at rest, (H, W).
"""

from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.flow.pipelines import float_pipeline
from fastac.models.floating import displacement_3d
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import bundle as bundles
from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.dataset import Dataset
from fastac.sensor.samples import SPLITS
from fastac.store.files import load_arrays, save_arrays
from fastac.store.steps import Output, Step
from fastac.studies.reproduce.section import one_ball

FILE = "displacements.npz"

Fields = tuple[dict[str, np.ndarray], dict[str, np.ndarray]]
"""Displacements (frames, 3, N, N) in mm and forces (frames, 3) in N, by split."""


def true_step(scene: Scene, data: Path | Output) -> Step:
    return Step("displacements-true", write_true, {"scene": scene, "data": data}, (FILE,))


def found_step(
    scene: Scene,
    data: Path | Output,
    *,
    bundle: Path | Output | None = None,
    weights: Output | None = None,
    store: Path,
    progress: bool,
) -> Step:
    """By the float pipeline of a bundle, or with the pixel network's weights."""
    arguments = {"scene": scene, "data": data, "bundle": bundle, "weights": weights}
    unkeyed = {"store": store, "progress": progress}
    return Step("displacements-found", write_found, arguments, (FILE,), unkeyed)


def write_true(folder: Path, scene: Scene, data: Path) -> None:
    """A step: what the dataset itself says."""
    known, arrays = dataset.read(data, scene), {}
    for split in SPLITS:
        index = one_ball(known, split)
        normal = known.rest_depth_mm - known.depth_mm[index]
        whole = np.concatenate([known.tangential_mm[index], normal[..., None]], axis=-1)
        arrays[f"{split}.field_mm"] = np.ascontiguousarray(whole[:, 1:-1, 1:-1].transpose(0, 3, 1, 2))
        arrays[f"{split}.kept"] = np.ones(len(index), bool)
    save(folder / FILE, arrays, known)


def write_found(
    folder: Path,
    scene: Scene,
    data: Path,
    bundle: Path | None,
    weights: Path | None,
    *,
    store: Path,
    progress: bool,
) -> None:
    """A step: d_z by the float pipeline, d_x and d_y by the markers."""
    known = frames.read(data, scene, store=store, progress=progress)
    if bundle is not None:
        pipeline = FloatPipeline.from_bundle(bundles.load_for(bundle, scene))
    else:
        pipeline = float_pipeline(load_arrays(weights), known, scene)
    save(folder / FILE, find_arrays(pipeline, known, progress=progress), known)


def find_arrays(pipeline: FloatPipeline, data: Dataset, *, progress: bool) -> dict[str, np.ndarray]:
    """What the frames show: `.field_mm` and `.kept` of each split."""
    arrays = {}
    for split in SPLITS:
        found = displacement_3d.displacement_fields(
            pipeline, data.frames[one_ball(data, split)], progress=progress
        )
        arrays |= {f"{split}.field_mm": found.field_mm, f"{split}.kept": found.kept}
    return arrays


def save(path: Path, arrays: dict[str, np.ndarray], data: Dataset) -> None:
    """Write displacements together with the forces that belong to them and the skin at rest."""
    for split in SPLITS:
        index = one_ball(data, split)[arrays[f"{split}.kept"]]
        arrays[f"{split}.force_n"] = data.forces_n(index, (0, 1, 2))
    save_arrays(path, {**arrays, "rest_depth_mm": data.rest_depth_mm})


def fields(arrays: dict[str, np.ndarray]) -> Fields:
    """Of a file's arrays: displacements and forces."""
    return tuple({split: arrays[f"{split}.{key}"] for split in SPLITS} for key in ("field_mm", "force_n"))


def kept(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Of a file's arrays: which frames of each split it has, bool."""
    return {split: arrays[f"{split}.kept"] for split in SPLITS}
