"""Experiments on what limits gradients and depth; each switches off one thing, all else stays as it is."""

import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.flow import frames, training
from fastac.flow.pipelines import float_pipeline, rest_depth_mm
from fastac.models import accuracy
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.result import Result
from fastac.models.vision import image_processing
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.dataset import SPLITS, Dataset
from fastac.sensor.geometry import pixel_centres_mm, rest_slopes
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.sensor.optics.skin_paint import coverage
from fastac.sensor.rerender import rerender
from fastac.sensor.samples import subset
from fastac.store.files import load_arrays, write_json
from fastac.store.progress import progress_bar
from fastac.store.side_by_side import perform_all
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.studies.reproduce.geometry import absolute_depth_mm, judge, rgb_data, rgb_scene
from fastac.studies.reproduce.section import Finished, vertical

WEIGHTS, ERRORS = "normals.npz", "errors.json"
NOISELESS_ELECTRONS_PER_DN = 1e6
"""The photon noise of n digital numbers is then √n / 1000 of one, below any rounding."""
SPARSE = 2
"""Networks learn from every SPARSE-th row and column; batches are as much smaller."""
RECORDED, NOISELESS, IDEAL = "as recorded", "no camera noise", "none of these"
WITH_RGB = (RECORDED, NOISELESS, IDEAL)
"""The experiments that are done with RGB-only too."""


def variants(sensor: Sensor) -> dict[str, Sensor]:
    """The sensor less one of its imperfections each, and less all of them; those that it has."""
    noise = {"noise_dn": 0.0, "electrons_per_dn": NOISELESS_ELECTRONS_PER_DN}
    if sensor.frames == "raw10":
        still = {"electrons_per_dn": NOISELESS_ELECTRONS_PER_DN, "read_noise_dn": 0.0}
        noise["raw10"] = sensor.raw10.model_copy(update=still)
    plain = {"specular": 0.0, "cast_shadows": False}
    changes = {
        NOISELESS: noise,
        "no grain of the paint": {"grain": 0.0},
        "no dots": {"markers": None},
        "no gloss, no cast shadows": {"light": sensor.light.model_copy(update=plain)},
    }
    found = {name: sensor.model_copy(update=change) for name, change in changes.items()}
    found = {name: changed for name, changed in found.items() if changed != sensor}
    if len(found) > 1:
        everything = {key: value for change in changes.values() for key, value in change.items()}
        found[IDEAL] = sensor.model_copy(update=everything)
    return {RECORDED: sensor} | found


def seen_by(sensor: Sensor, data: Dataset, seed: int, *, label: str, progress: bool) -> Dataset:
    """The presses of a dataset as another sensor sees them, in channels."""
    background, draw = rerender(data, sensor, seed)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        done = pool.map(lambda sample: image_processing.as_channels(draw(sample), sensor), range(len(data)))
        images = np.stack(list(progress_bar(done, total=len(data), desc=label, enabled=progress)))
    return replace(data, frames=images, background=image_processing.as_channels(background, sensor))


def train(
    folder: Path,
    scene: Scene,
    trained: Scene,
    sensor: Sensor | None,
    data: Path,
    *,
    label: str,
    store: Path,
    progress: bool,
) -> None:
    """A step: a pixel network trained and judged on the vertical presses of a scene's dataset.

    trained : what the network is trained by; where it lacks NIR, so do the frames
    sensor : that the presses are drawn for anew; None leaves the frames as they are
    """
    known = _vertical_presses(frames.read(data, scene, store=store, progress=progress))
    if sensor is not None:
        known = seen_by(sensor, known, scene.protocol.seed, label=label, progress=progress)
    if trained.sensor.channels == "bgr":
        known = rgb_data(known)
    sparse = np.zeros(known.normals.shape[:3], bool)
    sparse[:, ::SPARSE, ::SPARSE] = True
    training.normals(replace(known, valid=sparse), trained, folder / WEIGHTS, progress=progress)
    pipeline = float_pipeline(load_arrays(folder / WEIGHTS), known, trained)
    errors, _ = judge(pipeline, known, known.indices("test"), progress=progress)
    write_json(folder / ERRORS, summary(errors))


def _vertical_presses(data: Dataset) -> Dataset:
    return subset(data, np.sort(np.concatenate([vertical(data, split) for split in SPLITS])))


def summary(errors: dict) -> dict[str, float]:
    """Of what `judge` found: the total gradient error and that of depth with prior."""
    return {
        "gradient_mae_mm_per_px": errors["gradient_mae_mm_per_px"]["total"],
        "depth_mae_mm": errors["depth_mae_mm"]["prior"],
    }


def wider(scene: Scene) -> Scene:
    """The scene with a pixel network twice as wide."""
    width = tuple(2 * neurons for neurons in scene.network.hidden)
    network = scene.network.model_copy(update={"width": width, "train_width": None})
    return scene.model_copy(update={"network": network})


def shape_alone(scene: Scene, sensor: Sensor) -> Scene:
    """The scene with depth alone as output and no pruning, bridging dots only where the sensor that is drawn
    has any."""
    bridged = scene.network.bridge_dots and sensor.markers is not None
    network = scene.network.model_copy(update={"bridge_dots": bridged, "prune": None})
    return scene.model_copy(update={"outputs": ("depth",), "network": network})


def network_steps(scene: Scene, data: Path, *, store: Path, progress: bool) -> dict[str, dict[str, Step]]:
    """By experiment and channels: the trainings on the scene's dataset in the file `data`."""
    sensors = variants(scene.sensor)
    experiments = {name: (scene, sensor) for name, sensor in sensors.items()}
    experiments[f"{RECORDED}, a network twice as wide"] = (wider(scene), scene.sensor)
    batch_px = -(-scene.training.normals_batch_px // SPARSE**2)
    sparse = scene.training.model_copy(update={"normals_batch_px": batch_px})
    steps = {}
    for name, (of, sensor) in experiments.items():
        of = of.model_copy(update={"training": sparse})
        known = {"scene": scene, "sensor": None if sensor == scene.sensor else sensor, "data": data}
        unkeyed = {"label": f"frames, {name}", "store": store, "progress": progress}
        by_channels = {"bgr": rgb_scene(of)} if name in WITH_RGB else {}
        by_channels["bgr+nir"] = of
        by_channels = {channels: shape_alone(its, sensor) for channels, its in by_channels.items()}
        steps[name] = {
            channels: Step("limits-network", train, {**known, "trained": its}, (WEIGHTS, ERRORS), unkeyed)
            for channels, its in by_channels.items()
        }
    return steps


def networks(scene: Scene, data: Path, *, store: Path, progress: bool) -> dict[str, dict]:
    """By experiment: errors of networks trained and judged on the vertical presses, by channels."""
    steps = network_steps(scene, data, store=store, progress=progress)
    everything = [step for by_channels in steps.values() for step in by_channels.values()]
    perform_all(store, everything, os.cpu_count() or 1, label="pixel networks", progress=progress)
    found = open_store(store)
    return {
        name: {
            channels: json.loads(found.perform(step).path(ERRORS).read_text())
            for channels, step in by_channels.items()
        }
        for name, by_channels in steps.items()
    }


def regions(build: Finished) -> dict[str, dict[str, float]]:
    """Where the gradient errors of the build's float pipeline are: shares of pixels and of the whole error.

    Under dots: of the pressed or of the resting skin, either of which spoils a difference. In contact: within
    the contact's radius of the ball's axis.
    """
    scene, data = build.scene, build.data
    index, sensor = vertical(data, "test"), build.scene.sensor
    pipeline = FloatPipeline.from_bundle(build.bundle)
    slopes = pipeline.run(data.frames[index], wanted=("slopes",), progress=build.progress).slopes
    error = np.abs(slopes - true_slopes(data, index)).sum(axis=-1) * scene.sensor.pitch_mm
    x, y = pixel_centres_mm(sensor)
    pose = {key: data.indenter[key][index, None, None] for key in ("x_mm", "y_mm", "contact_radius_mm")}
    contact = np.hypot(x - pose["x_mm"], y - pose["y_mm"]) <= pose["contact_radius_mm"]
    dots = np.zeros_like(contact)
    if sensor.markers is not None:
        rest = coverage(sensor, marker_pixels(sensor)) > 0
        dots = rest | np.stack([coverage(sensor, data.markers_px[k]) > 0 for k in index])
    parts = {"under dots": dots, "in contact": contact & ~dots, "elsewhere": ~contact & ~dots}
    return {
        name: {
            "pixels_percent": float(100 * part.mean()),
            "gradient_mae_mm_per_px": float(error[part].mean()),
            "error_percent": float(100 * error[part].sum() / error.sum()),
        }
        for name, part in parts.items()
        if part.any()
    }


def true_slopes(data: Dataset, index: np.ndarray) -> np.ndarray:
    """(frames, H, W, 2), float64."""
    normals = data.normals[index].astype(np.float64)
    return -normals[..., :2] / normals[..., 2:]


def solver(build: Finished) -> dict[str, float]:
    """Depth errors of the Poisson solver alone, from true normals, in mm: by what is solved for."""
    scene, data = build.scene, build.data
    index, rest_mm = vertical(data, "test"), rest_depth_mm(data)
    slopes = true_slopes(data, index)
    change = slopes - np.stack(rest_slopes(scene.sensor), axis=-1)
    depths = {
        "difference": rest_mm + absolute_depth_mm(change, scene, None),
        "absolute": absolute_depth_mm(slopes, scene, rest_mm),
    }
    return {
        mode: accuracy.depth_mae_mm(Result(depth_mm=depth), data, index) for mode, depth in depths.items()
    }
