"""Section "geometry": gradients and depth with and without NIR, depth with and without the boundary prior.

RGB-only uses the same frames without their NIR channel and a network of its own, trained on them exactly as
the build trains on all four channels. Errors are those of the float pipeline on the vertical presses of the
test grid, as in the paper.

With prior: the scene's own pipeline. Without: "Standard fast Poisson solvers usually imply the zero-boundary
condition" (Lu et al.), so the absolute slopes are integrated with a boundary of zero. The error that this
adds is a smooth surface, so depth without each frame's mean error is given too. The last variant is the
paper's own equation, absolute slopes with the prior, for scenes that solve for the difference from rest.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from fastac.flow import frames, training
from fastac.flow.pipelines import float_pipeline, rest_depth_mm
from fastac.models import accuracy
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer.laplacian import boundary_term
from fastac.models.result import Result
from fastac.report.figures import save_png
from fastac.report.paper import DEPTH_MAE_MM, GRADIENT_MAE_MM_PER_PX, GRADIENT_REDUCTION_PERCENT
from fastac.report.tables import Table
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import CHANNELS
from fastac.sensor.dataset import Dataset
from fastac.store.files import load_arrays, write_json
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.studies.reproduce.section import Finished, Known, beside, vertical

WEIGHTS = "normals-bgr.npz"
NAMES = {"bgr": "RGB-only", "bgr+nir": "RGB-NIR"}
COMPONENTS = ("x", "y", "total")
BOUNDARIES = {
    "prior": "with prior",
    "no_prior": "without prior",
    "no_prior_less_mean": "without prior, less each frame's mean",
    "prior_absolute": "with prior, absolute slopes",
}


def lacks(build: Known) -> str | None:
    """One line that says why this section cannot be run on the build; None if it can."""
    scene, data = build.scene, build.data
    if scene.sensor.channels != "bgr+nir":
        return f"sensor.channels = {scene.sensor.channels!r}: expected 'bgr+nir', which contains RGB"
    if not scene.wants_solver or scene.training.labels != "geometry":
        return f"outputs = {', '.join(scene.outputs)}: no depth is found from normals"
    if data.normals is None or data.depth_mm is None:
        return "the dataset lacks normals or depth_mm, which errors are measured against"
    return None


def rgb_scene(scene: Scene) -> Scene:
    """The scene without the NIR channel."""
    content = scene.model_dump(mode="json")
    content["sensor"]["channels"] = "bgr"
    return Scene.model_validate(content)


def rgb_data(data: Dataset) -> Dataset:
    """The dataset without its NIR channel."""
    kept = len(CHANNELS["bgr"])
    frames, background = (np.ascontiguousarray(x[..., :kept]) for x in (data.frames, data.background))
    return replace(data, channels=CHANNELS["bgr"], frames=frames, background=background)


def absolute_depth_mm(slopes: np.ndarray, scene: Scene, prior_mm: np.ndarray | None) -> np.ndarray:
    """Integrate slopes (frames, H, W, 2) to depth (frames, H, W) in mm.

    prior_mm : (H, W), whose boundary the depth takes; None: zero
    """
    pitch_mm = scene.sensor.pitch_mm
    boundary = np.zeros(slopes.shape[1:3]) if prior_mm is None else prior_mm
    depth = np.repeat(boundary[None].astype(np.float64), len(slopes), axis=0)
    source = source_of(slopes.astype(np.float64), scene.poisson.divergence)
    depth[:, 1:-1, 1:-1] = pitch_mm * solve(source - boundary_term(boundary / pitch_mm))
    return depth


def without_mean_error(depth_mm: np.ndarray, truth_mm: np.ndarray) -> np.ndarray:
    """Depth (frames, H, W) shifted frame by frame so that its mean inside the boundary is the true one."""
    error = (depth_mm - truth_mm)[:, 1:-1, 1:-1]
    return depth_mm - error.mean(axis=(1, 2), keepdims=True)


def judge(
    pipeline: FloatPipeline, data: Dataset, index: np.ndarray, *, progress: bool
) -> tuple[dict, dict[str, np.ndarray]]:
    """Errors of gradients, and of depth by BOUNDARIES; and the depths (frames, H, W) in mm by BOUNDARIES."""
    scene, rest_mm = pipeline.scene, pipeline.rest_depth_mm
    result = pipeline.run(data.frames[index], wanted=("normals", "slopes", "depth_mm"), progress=progress)
    errors = accuracy.normals(result, data, index, scene.sensor.pitch_mm)
    zero_boundary = absolute_depth_mm(result.slopes, scene, None)
    depths = {
        "prior": result.depth_mm,
        "no_prior": zero_boundary,
        "no_prior_less_mean": without_mean_error(zero_boundary, data.depth_mm[index]),
        "prior_absolute": absolute_depth_mm(result.slopes, scene, rest_mm),
    }
    found = {
        "gradient_mae_mm_per_px": {
            "x": errors["gradient_x_mae_mm_per_px"],
            "y": errors["gradient_y_mae_mm_per_px"],
            "total": errors["gradient_mae_mm_per_px"],
        },
        "normal_mae_deg": errors["normal_mae_deg"],
        "depth_mae_mm": {
            name: accuracy.depth_mae_mm(Result(depth_mm=depth), data, index) for name, depth in depths.items()
        },
    }
    return found, depths


def train_rgb(folder: Path, scene: Scene, reduced: Scene, data: Path, *, store: Path, progress: bool) -> None:
    """A step: train the pixel network of the scene `reduced`, which is `scene` without NIR."""
    of_rgb = rgb_data(frames.read(data, scene, store=store, progress=progress))
    training.normals(of_rgb, reduced, folder / WEIGHTS, progress=progress)


def run(folder: Path, scene: Scene, bundle: Path, data: Path, *, store: Path, progress: bool) -> None:
    """Train the RGB-only network, a step of its own; write both networks' errors and draw them."""
    build = Finished.read(scene, bundle, data, store=store, progress=progress)
    reduced = rgb_scene(scene)
    arguments = {"scene": scene, "reduced": reduced, "data": data}
    quiet = {"store": store, "progress": progress}
    step = Step("normals-rgb", train_rgb, arguments, (WEIGHTS,), quiet)
    weights = load_arrays(open_store(store).perform(step).path(WEIGHTS))
    known, of_rgb = build.data, rgb_data(build.data)
    pipelines = {
        "bgr": (float_pipeline(weights, of_rgb, reduced), of_rgb),
        "bgr+nir": (FloatPipeline.from_bundle(build.bundle), known),
    }
    index = vertical(known, "test")
    content, depths = {"frames": len(index), "channels": {}}, {}
    for channels, (pipeline, seen) in pipelines.items():
        content["channels"][channels], depths[channels] = judge(pipeline, seen, index, progress=progress)
    rgb, nir = (content["channels"][name]["gradient_mae_mm_per_px"] for name in NAMES)
    content["gradient_reduction_percent"] = {c: 100 * (1 - nir[c] / rgb[c]) for c in COMPONENTS}
    draw(content, depths, known, index, folder / "geometry.png")
    write_json(folder / "geometry.json", content)


def tables(content: dict) -> list[Table]:
    """Gradient errors, and depth errors by boundary, both beside the paper's."""
    gradient = {name: content["channels"][name]["gradient_mae_mm_per_px"] for name in NAMES}
    rows = [
        [
            {"total": "Total (MAE)"}.get(part, f"G_{part} (MAE)"),
            *beside(gradient["bgr"][part], GRADIENT_MAE_MM_PER_PX["bgr"][part], 5),
            *beside(gradient["bgr+nir"][part], GRADIENT_MAE_MM_PER_PX["bgr+nir"][part], 5),
            *beside(
                content["gradient_reduction_percent"][part], float(GRADIENT_REDUCTION_PERCENT[part]), digits=1
            ),
        ]
        for part in COMPONENTS
    ]
    depth = {name: content["channels"][name]["depth_mae_mm"] for name in NAMES}
    cells = [
        [
            label,
            *(cell for c in NAMES for cell in beside(depth[c][boundary], DEPTH_MAE_MM[c].get(boundary))),
        ]
        for boundary, label in BOUNDARIES.items()
    ]
    pair = [f"{name}, {whose}" for name in NAMES.values() for whose in ("ours", "paper")]
    return [
        Table(
            "Gradient error, mm/px",
            ["component", *pair, "reduction %, ours", "paper"],
            rows,
            f"{content['frames']} vertical presses of the test grid; the total is the components' sum.",
        ),
        Table(
            "Depth error (MAE), mm",
            ["boundary", *pair],
            cells,
            "With prior: the scene's pipeline. Without: absolute slopes, zero on the boundary."
            " The paper has the first two rows.",
        ),
    ]


def draw(
    content: dict, depths: dict[str, dict[str, np.ndarray]], data: Dataset, index: np.ndarray, path: Path
) -> None:
    """Write a PNG: errors as bars beside the paper's, and maps of the depth error of the deepest press."""
    figure = plt.figure(figsize=(13, 7))
    bars = [
        ("gradient MAE, mm/px", "gradient_mae_mm_per_px", COMPONENTS, GRADIENT_MAE_MM_PER_PX, False),
        ("depth MAE, mm", "depth_mae_mm", ("prior", "no_prior"), DEPTH_MAE_MM, True),
    ]
    for place, (label, key, parts, paper, is_log) in enumerate(bars, start=1):
        axis = figure.add_subplot(2, 2, place)
        at = np.arange(len(parts))
        for k, channels in enumerate(NAMES):
            ours = [content["channels"][channels][key][part] for part in parts]
            theirs = [paper[channels][part] for part in parts]
            colour = f"C{k}"
            axis.bar(at + (2 * k - 1.5) * 0.2, ours, 0.19, color=colour, label=f"{NAMES[channels]}, ours")
            style = {"color": "white", "edgecolor": colour, "hatch": "//"}
            axis.bar(at + (2 * k - 0.5) * 0.2, theirs, 0.19, label=f"{NAMES[channels]}, the paper's", **style)
        axis.set_xticks(
            at, [BOUNDARIES.get(part, f"G_{part}" if part != "total" else part) for part in parts]
        )
        axis.set_ylabel(label)
        if is_log:
            axis.set_yscale("log")
        axis.legend(fontsize=7)
    truth = data.depth_mm[index]
    deepest = int((rest_depth_mm(data) - truth).max(axis=(1, 2)).argmax())
    panels = [(c, b) for c in NAMES for b in ("prior", "no_prior")]
    for place, (channels, boundary) in enumerate(panels, start=5):
        axis = figure.add_subplot(2, 4, place)
        error = (depths[channels][boundary][deepest] - truth[deepest])[1:-1, 1:-1]
        limit = np.abs(error).max()
        shown = axis.imshow(error, cmap="coolwarm", vmin=-limit, vmax=limit)
        axis.set_title(f"{NAMES[channels]}, {BOUNDARIES[boundary]}: depth error, mm", fontsize=7)
        axis.axis("off")
        figure.colorbar(shown, ax=axis, shrink=0.8).ax.tick_params(labelsize=6)
    figure.suptitle(f"{data.source}; below: the deepest press", fontsize=9)
    save_png(figure, path)
