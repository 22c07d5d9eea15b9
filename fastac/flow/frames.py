"""Frames as the models take them: the channels of RAW10 images, processed once and kept.

Builds and sweeps read their frames here. Where a scene's frames are channels already, nothing is processed
and nothing is kept.
"""

import dataclasses
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from fastac.models.integer.light_level import levelled
from fastac.models.vision.image_processing import as_channels, channels
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor import dataset
from fastac.sensor.dataset import Dataset
from fastac.sensor.fingertip import STORE, sample
from fastac.sensor.mechanics.press import PressedSkin
from fastac.store.files import load_arrays, save_arrays
from fastac.store.progress import progress_bar
from fastac.store.steps import Step
from fastac.store.store import open_store

PROCESSED = "frames.npz"


def in_scene(frames: np.ndarray, background: np.ndarray, scene: Scene) -> np.ndarray:
    """Frames of channels (frames, H, W, C) uint8 as the scene's models take them, against a background
    (H, W, C): with `sensor.level_light` levelled, else as they are."""
    return levelled(frames, background) if scene.sensor.level_light else frames


def of_press(pressed: PressedSkin, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """What the virtual camera sees of a press, as the models take it: (H, W, C) uint8."""
    return as_channels(sample(pressed, sensor, rng)["frame"], sensor)


def read(path: Path | str, scene: Scene, *, store: Path | str = STORE, progress: bool = False) -> Dataset:
    """The dataset in a file, as `sensor.dataset.read`, its frames channels in any case, and as `in_scene`.

    Those of RAW10 images are processed in a step of their own, kept in the step store in the folder `store`.
    """
    if scene.sensor.frames == "raw10":
        arguments = {"data": Path(path), "scene": scene}
        step = Step("frames", process, arguments, (PROCESSED,), {"progress": progress})
        kept = load_arrays(open_store(Path(store)).perform(step).path(PROCESSED))
        data = dataset.read(path, instead_of_raw10=kept)  # which the step has found to be the scene's
    else:
        data = dataset.read(path, scene)
    return dataclasses.replace(data, frames=in_scene(data.frames, data.background, scene))


def process(folder: Path, data: Path, scene: Scene, *, progress: bool) -> None:
    """A step: the channels of all RAW10 frames and of the background of a dataset."""
    known, sensor = dataset.read(data, scene), scene.sensor
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        done = pool.map(lambda raw: channels(raw, sensor), known.raw10)
        bar = progress_bar(done, total=len(known), desc="image processing", enabled=progress)
        frames = np.stack(list(bar))
    arrays = {"frames": frames, "background": channels(known.background, sensor)}
    save_arrays(folder / PROCESSED, arrays)
