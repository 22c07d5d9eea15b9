"""Frames as the models take them: the channels of RAW10 images, processed once and kept.

The one place where a dataset's frames are processed. Where a scene's frames are channels nothing is, and
nothing is kept.
"""

import dataclasses
import hashlib
import json
import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from zipfile import BadZipFile

import cv2
import numpy as np

from fastac.models.vision.image_processing import as_channels, channels
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor import dataset
from fastac.sensor.dataset import Dataset, DatasetError
from fastac.sensor.fingertip import sample
from fastac.sensor.mechanics.press import PressedSkin
from fastac.store.files import digest_file
from fastac.store.progress import progress_bar
from fastac.store.sources import digest_sources

CACHE = Path("build/cache")
"""Where processed frames are kept, unless the caller says otherwise."""


def of_press(pressed: PressedSkin, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """What the virtual camera sees of a press, as the models take it: (H, W, C) uint8."""
    return as_channels(sample(pressed, sensor, rng)["frame"], sensor)


def read(path: Path | str, scene: Scene, *, cache: Path | str = CACHE, progress: bool = False) -> Dataset:
    """The dataset in a file, as `sensor.dataset.read`, its frames channels in any case.

    Those of RAW10 images are kept in the folder `cache`, named by a hash of file, settings and code.
    """
    data = dataset.read(path, scene)
    if data.raw10 is None:
        return data
    kept = Path(cache) / f"frames-{_content_hash(Path(path), scene.sensor)[:24]}.npz"
    if not kept.exists():
        _keep(kept, data, scene.sensor, progress)
    try:
        with np.load(kept, allow_pickle=False) as stored:
            frames, background = stored["frames"], stored["background"]
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise DatasetError(f"{kept}: damaged ({error}): delete it") from None
    return dataclasses.replace(data, raw10=None, frames=frames, background=background)


def _content_hash(path: Path, sensor: Sensor) -> str:
    """Of everything that the processed frames depend on."""
    settings = [sensor.channels, sensor.raw10.model_dump(mode="json"), cv2.__version__]
    sources = digest_sources(
        ("models/vision/image_processing.py", "sensor/optics/mosaic.py", "fastac/flow/frames.py")
    )
    return hashlib.sha256(json.dumps([settings, sources, digest_file(path)]).encode()).hexdigest()


def _keep(path: Path, data: Dataset, sensor: Sensor, progress: bool) -> None:
    """Process all frames of `data` into `path`, which appears complete or not at all."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        done = pool.map(lambda raw: channels(raw, sensor), data.raw10)
        bar = progress_bar(done, total=len(data), desc="image processing", enabled=progress)
        frames = np.stack(list(bar))
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, frames=frames, background=channels(data.background, sensor))
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
