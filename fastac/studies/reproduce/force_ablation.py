"""The paper's ablation of HyperForce: kernels dynamic or fixed, inputs d_x + d_y, d_z or all three.

    fastac study force-ablation SCENE|BUILD --data FILE

Each of the six is trained on the training grid, stopped by the validation grid and judged on the test grid:
on true displacements, which shows what the model itself can do, and on those found in the frames, d_z by the
float pipeline and d_x, d_y by the markers. Each training is a step of the store and goes on from its
checkpoint after an interruption.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib

from fastac.report.figures import save_png
from fastac.report.tables import text_table
from fastac.scenes.schema import AXES

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from fastac.flow import frames
from fastac.flow import steps as build_steps
from fastac.flow.steps import NORMALS
from fastac.models.integer.bundle import bundle_folder, is_bundle, load_bundle
from fastac.models.training.force.hyperforce_3d import input_components, train
from fastac.report.paper import FORCE_FULL, FORCE_MAE_N
from fastac.scenes import schema as scenes
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset, DatasetError
from fastac.sensor.samples import SPLITS
from fastac.store.checkpoint import checkpoint
from fastac.store.files import load_arrays, write_json
from fastac.store.steps import Output, Step
from fastac.store.store import open_store
from fastac.studies.reproduce.displacements import FILE, fields, found_step, kept, true_step
from fastac.studies.reproduce.section import one_ball

RESULT, PLOT = "force_ablation.json", "force_ablation.png"


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


def form_step(
    scene: Scene, displacements: Output, kernel: str, inputs: str, *, store: Path, progress: bool
) -> Step:
    """One of the six trained; its value has the forces found in the test split and the learning curve."""
    known = {"scene": scene, "displacements": displacements, "kernel": kernel, "inputs": inputs}
    step = Step("hyperforce", train_form, known)
    return replace(step, unkeyed={"checkpoint": checkpoint(open_store(store), step), "progress": progress})


def train_form(
    folder: Path,
    scene: Scene,
    displacements: Path,
    kernel: str,
    inputs: str,
    *,
    checkpoint: Path,
    progress: bool,
) -> dict:
    """The step behind `form_step`: goes on from the checkpoint where an earlier run was interrupted."""
    arrays = load_arrays(displacements)
    field_mm, force_n = fields(arrays)
    model, history = train(
        scene,
        arrays["rest_depth_mm"].astype(np.float64),
        field_mm,
        force_n,
        inputs=inputs,
        dynamic=kernel == "dynamic",
        checkpoint=checkpoint,
        progress=progress,
    )
    found_n = model(input_components(scene, field_mm["test"], inputs)).detach().double()
    checkpoint.unlink(missing_ok=True)
    return {"force_n": found_n.tolist(), "history": history}


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


def compare(
    scene: Scene,
    path: Path,
    kinds: tuple[str, ...],
    output: Path,
    *,
    bundle: Path | None,
    store: Path,
    progress: bool,
) -> dict:
    """All six on the dataset in `path`, for each kind of displacement; plots the full model's forces.

    bundle : a bundle whose network finds displacements; without one, a network is trained for them
    """
    data = frames.read(path, scene, store=store, progress=progress)
    require(data, scene, path, "true" in kinds)
    content, pairs = {}, {}
    for kind in kinds:
        step = true_step(scene, path)
        if kind == "found":
            weights = None if bundle else normals_step(scene, path, store=store, progress=progress)
            step = found_step(scene, path, bundle=bundle, weights=weights, store=store, progress=progress)
        arrays = load_arrays(open_store(store).perform(step).path(FILE))
        truth_n, found_n, results = arrays["test.force_n"], {}, {}
        for form in FORCE_MAE_N:
            trained = form_step(scene, step.output(FILE), *form, store=store, progress=progress)
            value = open_store(store).value(trained)
            found_n[form] = np.array(value["force_n"])
            results[" ".join(form)] = {**errors(found_n[form], truth_n), "history": value["history"]}
        content[kind] = {"results": results}
        if kind == "found":
            content[kind]["lost_frames"] = {name: int((~seen).sum()) for name, seen in kept(arrays).items()}
        pairs[kind] = truth_n, found_n["dynamic", "xyz"]
    plot(output / PLOT, pairs, data.source)
    paper = {f"{kernel} {inputs}": {"mae_n": mae} for (kernel, inputs), mae in FORCE_MAE_N.items()}
    paper["dynamic xyz"] |= FORCE_FULL
    return {
        "source": data.source,
        "frames": {split: len(one_ball(data, split)) for split in SPLITS},
        "paper": paper,
        "displacements": content,
    }


def normals_step(scene: Scene, data: Path, *, store: Path, progress: bool) -> Output:
    """The pixel network's weights: the same step as a build's."""
    unkeyed = {"store": store, "progress": progress}
    step = Step("normals", build_steps.normals, {"scene": scene, "data": data}, (NORMALS,), unkeyed)
    return step.output(NORMALS)


def run(
    origin: Path, path: Path, output: Path, kinds: tuple[str, ...], store: Path, *, progress: bool
) -> dict:
    """The comparison for a scene's file, a bundle or a build folder; writes JSON and plot to `output`."""
    bundle = bundle_folder(origin) if is_bundle(origin) else None
    scene = load_bundle(origin).scene if bundle else scenes.load(origin)
    output.mkdir(parents=True, exist_ok=True)
    found = compare(scene, path, kinds, output, bundle=bundle, store=store, progress=progress)
    found = {"data": str(path), **found}
    write_json(output / RESULT, found)
    return found
