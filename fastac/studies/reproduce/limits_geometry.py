"""Experiments on what limits gradients and depth; each switches off one thing, all else stays as it is."""

import json
import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fastac.flow import training
from fastac.flow.build import Build
from fastac.flow.settings import float_settings
from fastac.models import accuracy
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.result import Result
from fastac.models.vision import image_processing
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.dataset import SPLITS, Dataset
from fastac.sensor.geometry import pixel_centres_mm, rest_slopes
from fastac.sensor.optics.skin_paint import coverage, marker_pixels
from fastac.sensor.rerender import rerender
from fastac.sensor.samples import subset
from fastac.store.files import content_hash, load_arrays, write_json
from fastac.store.progress import progress_bar
from fastac.store.sources import digest_sources
from fastac.studies.reproduce.geometry import absolute_depth_mm, judge, rgb_data, rgb_scene
from fastac.studies.reproduce.section import stamped_key, vertical

SOURCES = (
    "models/**/*.py",
    "sensor/**/*.py",
    "fastac/flow/training.py",
    "fastac/flow/frames.py",
    "fastac/studies/reproduce/limits_geometry.py",
)
NOISELESS_ELECTRONS_PER_DN = 1e6
"""The photon noise of n digital numbers is then √n / 1000 of one, below any rounding."""


SPARSE = 2
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


@dataclass(frozen=True)
class Training:
    """A pixel network to be trained on a dataset, and the file for its weights.

    It learns from every SPARSE-th row and column, in batches as much smaller: as many steps, in less time.
    """

    scene: Scene
    data: Dataset
    weights: Path

    def perform(self, *, progress: bool = False) -> None:
        known = np.zeros(self.data.normals.shape[:3], bool)
        known[:, ::SPARSE, ::SPARSE] = True
        batch_px = -(-self.scene.training.normals_batch_px // SPARSE**2)
        settings = self.scene.training.model_copy(update={"normals_batch_px": batch_px})
        sparse = self.scene.model_copy(update={"training": settings})
        training.normals(replace(self.data, valid=known), sparse, self.weights, progress=progress)

    def errors(self, *, progress: bool) -> dict[str, float]:
        """Of gradients and depth on the test split, all pixels."""
        arrays = load_arrays(self.weights)
        pipeline = training.float_pipeline(arrays, self.data, self.scene)
        return summary(judge(pipeline, self.data, self.data.indices("test"), progress=progress)[0])


def train_all(trainings: list[Training], processes: int, *, progress: bool) -> None:
    """Those whose weights are not there yet, each on one core; the results do not depend on `processes`."""
    missing = [one for one in trainings if not one.weights.exists()]
    if processes == 1 or len(missing) < 2:
        for one in missing:
            one.perform(progress=progress)
        return
    # What a network does not learn from need not travel.
    slim = [replace(one, data=replace(one.data, depth_mm=None, tangential_mm=None)) for one in missing]
    with multiprocessing.get_context("spawn").Pool(min(processes, len(slim))) as pool:
        done = pool.imap_unordered(Training.perform, slim)
        list(progress_bar(done, total=len(slim), desc="pixel networks", enabled=progress))


def summary(errors: dict) -> dict[str, float]:
    """Of what `judge` found: the total gradient error and that of depth with prior."""
    return {
        "gradient_mae_mm_per_px": errors["gradient_mae_mm_per_px"]["total"],
        "depth_mae_mm": errors["depth_mae_mm"]["prior"],
    }


def wider(scene: Scene) -> Scene:
    """The scene with a pixel network twice as wide."""
    network = scene.network.model_copy(update={"width": 2 * scene.network.width})
    return scene.model_copy(update={"network": network})


def networks(build: Build, folder: Path) -> dict[str, dict]:
    """By experiment: errors of networks trained and judged on the vertical presses, by channels."""
    scene = build.scene
    index = np.sort(np.concatenate([vertical(build.data, split) for split in SPLITS]))
    data = subset(build.data, index)
    experiments = {name: (scene, sensor) for name, sensor in variants(scene.sensor).items()}
    experiments[f"{RECORDED}, a network twice as wide"] = (wider(scene), scene.sensor)
    base = [stamped_key(build, "data"), digest_sources(SOURCES)]
    files, drawn = {}, {}
    for name, (of, sensor) in experiments.items():
        slug = name.replace(",", "").replace(" ", "-")
        key = content_hash(*base, name, float_settings(of), sensor.model_dump(mode="json"))
        files[name] = folder / f"{slug}-{key}.json"
        if files[name].exists():
            continue
        seen = data
        if sensor != scene.sensor:
            label = f"frames, {name}"
            seen = seen_by(sensor, data, scene.protocol.seed, label=label, progress=build.progress)
        pairs = {"bgr": (rgb_scene(of), rgb_data(seen))} if name in WITH_RGB else {}
        pairs["bgr+nir"] = (of, seen)
        drawn[name] = {
            channels: Training(its, part, folder / f"{slug}-{channels}-{key}.npz")
            for channels, (its, part) in pairs.items()
        }
    everything = [one for trainings in drawn.values() for one in trainings.values()]
    train_all(everything, os.cpu_count() or 1, progress=build.progress)
    for name, trainings in drawn.items():
        errors = {channels: one.errors(progress=build.progress) for channels, one in trainings.items()}
        write_json(files[name], errors)
    return {name: json.loads(file.read_text()) for name, file in files.items()}


def regions(build: Build) -> dict[str, dict[str, float]]:
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


def solver(build: Build) -> dict[str, float]:
    """Depth errors of the Poisson solver alone, from true normals, in mm: by what is solved for."""
    scene, data = build.scene, build.data
    index, rest_mm = vertical(data, "test"), training.rest_depth_mm(data)
    slopes = true_slopes(data, index)
    change = slopes - np.stack(rest_slopes(scene.sensor), axis=-1)
    depths = {
        "difference": rest_mm + absolute_depth_mm(change, scene, None),
        "absolute": absolute_depth_mm(slopes, scene, rest_mm),
    }
    return {
        mode: accuracy.depth_mae_mm(Result(depth_mm=depth), data, index) for mode, depth in depths.items()
    }
