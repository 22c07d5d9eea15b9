"""The paper's ablation of HyperForce: kernels dynamic or fixed, inputs d_x + d_y, d_z or all three.

    fastac study force-ablation SCENE|BUILD --data FILE

Each of the six is trained on the training grid, stopped by the validation grid and judged on the test grid:
on true displacements, which shows what the model itself can do, and on those found in the frames, d_z by the
float pipeline and d_x, d_y by the markers. Runs that are complete, or interrupted, are taken from the output.
"""

from pathlib import Path

import matplotlib

from fastac.models.integer.bundle import load_bundle
from fastac.report.figures import save_png
from fastac.report.tables import text_table
from fastac.scenes.schema import AXES

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from fastac.flow import frames, training
from fastac.flow.settings import float_settings
from fastac.models.floating import displacement_3d
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.training.hyperforce_3d import input_components, train
from fastac.report.paper import FORCE_FULL, FORCE_MAE_N
from fastac.scenes import schema as scenes
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset, DatasetError
from fastac.sensor.samples import SPLITS
from fastac.store.files import content_hash, digest_file, load_arrays, read_or_make, save_arrays, write_json
from fastac.store.sources import digest_sources

SOURCES = ("models/**/*.py", "fastac/studies/reproduce/force_ablation.py", "fastac/flow/training.py")

Fields = tuple[dict[str, np.ndarray], dict[str, np.ndarray]]
"""Displacements (frames, 3, N, N) in mm and forces (frames, 3) in N, by split."""


def require(data: Dataset, scene: Scene, path: Path, wants_truth: bool) -> None:
    """Raise DatasetError where the ablation lacks what it compares."""
    needed = {"rest_depth_mm": data.rest_depth_mm}
    if wants_truth:
        needed |= {"tangential_mm": data.tangential_mm, "depth_mm": data.depth_mm}
    for key, array in needed.items():
        if array is None:
            raise DatasetError(f"{path}: {key}: missing, and the displacement needs it")
    if not data.has_force((0, 1, 2)):
        raise DatasetError(f"{path}: force_n: expected all of x, y, z")
    if wants_truth and data.valid is not None and not data.valid.all():
        raise DatasetError(f"{path}: valid: geometry is known in parts only: expected the whole skin")
    for split in SPLITS:
        if not len(data.indices(split)):
            raise DatasetError(f"{path}: split: no frame is in {split!r}")
    if not scene.wants_solver:
        raise DatasetError(f"scene {scene.name}: outputs: no depth is found, and d_z needs it")


def true_fields(data: Dataset) -> Fields:
    fields, forces = {}, {}
    for split in SPLITS:
        index = data.indices(split)
        normal = data.rest_depth_mm - data.depth_mm[index]
        whole = np.concatenate([data.tangential_mm[index], normal[..., None]], axis=-1)
        fields[split] = np.ascontiguousarray(whole[:, 1:-1, 1:-1].transpose(0, 3, 1, 2))
        forces[split] = data.forces_n(index, (0, 1, 2))
    return fields, forces


def find_arrays(pipeline: FloatPipeline, data: Dataset, *, progress: bool) -> dict[str, np.ndarray]:
    """What the frames show: of each split the displacements `.field_mm` of the frames that are `.kept`."""
    arrays = {}
    for split in SPLITS:
        found = displacement_3d.displacement_fields(
            pipeline, data.frames[data.indices(split)], progress=progress
        )
        arrays |= {f"{split}.field_mm": found.field_mm, f"{split}.kept": found.kept}
    return arrays


def found_fields(arrays: dict[str, np.ndarray], data: Dataset) -> tuple[Fields, dict[str, int]]:
    """Of `find_arrays`: displacements and forces, and how many frames of each split lack their markers."""
    fields, forces, lost = {}, {}, {}
    for split in SPLITS:
        seen = arrays[f"{split}.kept"]
        fields[split] = arrays[f"{split}.field_mm"]
        forces[split] = data.forces_n(data.indices(split)[seen], (0, 1, 2))
        lost[split] = int((~seen).sum())
    return (fields, forces), lost


def errors(found_n: np.ndarray, truth_n: np.ndarray) -> dict[str, list[float]]:
    """Of each component, forces (frames, 3): normalised by its largest true load, as in the paper."""
    error, truth = found_n - truth_n.astype(np.float64), truth_n.astype(np.float64)
    largest = np.abs(truth).max(axis=0)
    mae, rmse = np.abs(error).mean(axis=0), np.sqrt((error**2).mean(axis=0))
    total = ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    if not largest.all() or not total.all():
        raise DatasetError("force_n: a component does not vary in the test split: nothing to compare")
    return {
        "mae_n": mae.tolist(),
        "rmse_n": rmse.tolist(),
        "nmae_percent": (100 * mae / largest).tolist(),
        "nrmse_percent": (100 * rmse / largest).tolist(),
        "r2": (1 - (error**2).sum(axis=0) / total).tolist(),
    }


def ablate(
    scene: Scene, rest_depth_mm: np.ndarray, parts: Fields, folder: Path, key: str, *, progress: bool
) -> tuple[dict[str, dict], np.ndarray]:
    """All six trained and judged, by "kernel inputs", and the full model's forces (test frames, 3) in N.

    What a finished model finds is kept in `folder`, as are the checkpoints of those under way.
    """
    fields, forces = parts
    results = {}
    for kernel, inputs in FORCE_MAE_N:
        path = folder / f"{kernel}-{inputs}-{key}.json"

        def finished(kernel=kernel, inputs=inputs, path=path) -> dict:
            model, history = train(
                scene,
                rest_depth_mm,
                fields,
                forces,
                inputs=inputs,
                dynamic=kernel == "dynamic",
                checkpoint=path.with_suffix(".npz"),
                progress=progress,
            )
            found_n = model(input_components(scene, fields["test"], inputs)).detach().double()
            return {"force_n": found_n.tolist(), "history": history}

        kept = read_or_make(path, finished)
        found_n = np.array(kept["force_n"])
        results[f"{kernel} {inputs}"] = {**errors(found_n, forces["test"]), "history": kept["history"]}
        if (kernel, inputs) == ("dynamic", "xyz"):
            full_n = found_n
    return results, full_n


def table(content: dict) -> str:
    """Ours beside the paper's, as text."""
    lines = [f"frames: {content['frames']}; ours: {content['source']}; the paper's: its own sensor"]
    for name, found in content["displacements"].items():
        lines += ["", f"{name} displacements: mean absolute error, N, ours (the paper's)"]
        results, full = found["results"], found["results"]["dynamic xyz"]
        rows = [(*form, results[" ".join(form)]["mae_n"], paper) for form, paper in FORCE_MAE_N.items()]
        rows += [("dynamic", f"xyz, {key}", full[key], paper) for key, paper in FORCE_FULL.items()]
        lines.append(
            text_table(
                ["kernel", "inputs", *(f"F_{axis}" for axis in AXES)],
                [
                    [*form, *(f"{a:.4f} ({b:.4f})" for a, b in zip(ours, paper, strict=True))]
                    for *form, ours, paper in rows
                ],
            )
        )
        if any(found.get("lost_frames", {}).values()):
            lines.append(f"  left out, markers lost: {found['lost_frames']}")
    return "\n".join(lines)


def plot(path: Path, pairs: dict[str, tuple[np.ndarray, np.ndarray]], source: str) -> None:
    """The full model's forces against the true ones, a row for each kind of displacement."""
    figure, grid = plt.subplots(len(pairs), 3, figsize=(10, 3.4 * len(pairs)), squeeze=False)
    for row, (name, (truth_n, found_n)) in zip(grid, pairs.items(), strict=True):
        for k, axis in enumerate(row):
            ends = [truth_n[:, k].min(), truth_n[:, k].max()]
            axis.plot(ends, ends, color="0.6", linewidth=0.8)
            axis.scatter(truth_n[:, k], found_n[:, k], s=4)
            axis.set(
                xlabel=f"true F_{AXES[k]}, N", ylabel=f"found F_{AXES[k]}, N", title=f"{name} displacements"
            )
    figure.suptitle(f"HyperForce on d_x, d_y, d_z; test grid; {source}", fontsize=9)
    figure.tight_layout()
    save_png(figure, path)


def run(
    origin: Path,
    path: Path,
    output: Path,
    kinds: tuple[str, ...],
    store: Path,
    *,
    data: Dataset | None = None,
    progress: bool,
) -> dict:
    """The whole comparison, written to the folder `output`; returns what its JSON holds.

    data : the dataset in the file `path`, if it has been read already
    """
    bundle = load_bundle(origin) if origin.is_dir() else None
    scene = bundle.scene if bundle else scenes.load(origin)
    if data is None:
        data = frames.read(path, scene, store=store, progress=progress)
    require(data, scene, path, "true" in kinds)
    code, digest = digest_sources(SOURCES), digest_file(path)
    runs, content, pairs = output / "runs", {}, {}
    base = [float_settings(scene), code, digest]
    for kind in kinds:
        known, key = {}, content_hash(kind, *base)
        if kind == "true":
            parts = true_fields(data)
        else:
            if bundle:
                pipeline = FloatPipeline.from_bundle(bundle)
                network = {k: v.tolist() for k, v in bundle.floats.items() if k.startswith("network.")}
                key = content_hash(key, network)
            else:
                weights = runs / f"normals-{content_hash(*base)}.npz"
                weights.parent.mkdir(parents=True, exist_ok=True)
                if not weights.exists():
                    training.normals(data, scene, weights, progress=progress)
                pipeline = training.float_pipeline(load_arrays(weights), data, scene)
            kept = runs / f"displacement-{key}.npz"
            if not kept.exists():
                kept.parent.mkdir(parents=True, exist_ok=True)
                save_arrays(kept, find_arrays(pipeline, data, progress=progress))
            parts, known["lost_frames"] = found_fields(load_arrays(kept), data)
            known["file"] = str(kept.relative_to(output))
        rest = data.rest_depth_mm.astype(np.float64)
        known["results"], full_n = ablate(scene, rest, parts, runs, f"{kind}-{key}", progress=progress)
        content[kind], pairs[kind] = known, (parts[1]["test"], full_n)
    found = {
        "data": str(path),
        "source": data.source,
        "frames": {split: len(data.indices(split)) for split in SPLITS},
        "paper": {f"{kernel} {inputs}": {"mae_n": mae} for (kernel, inputs), mae in FORCE_MAE_N.items()},
        "displacements": content,
    }
    found["paper"]["dynamic xyz"] |= FORCE_FULL
    write_json(output / "force_ablation.json", found)
    plot(output / "force_ablation.png", pairs, data.source)
    return found
