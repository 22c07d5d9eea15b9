"""Where frames come from: a dataset, a video, a folder of photographs or arrays, or a camera.

Each is an iterable of frames (H, W, C) uint8 in the order of the scene's channels. Frames of another size are
refused in one line, unless they are as large as the photographs that the sensor's dataset was imported from,
or the user asks for it: then they are resampled as the importer resampled those (fastac/driver/fitting.py).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.driver.fitting import Fitting, SourceError, fitted
from fastac.flow.frames import read
from fastac.models.vision.image_processing import as_channels
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.importers.cnc_frames import BACKGROUND, SUFFIXES, CncFrames
from fastac.sensor.importers.footage import SUFFIXES as PHOTOGRAPHS
from fastac.sensor.importers.footage import Video, by_number, file_in, photograph
from fastac.sensor.samples import split_indices

DATASETS = (".h5", ".hdf5")
CAMERA = "camera:"
DEVICES = "/dev/video"

__all__ = ["Fitting", "Source", "SourceError", "open_source"]


@dataclass(frozen=True)
class Source:
    """Frames, how many there are (None: unknown), and what the untouched sensor sees, where it is known.

    live : frames come when they come: each is to be answered before the next one is asked for
    frames_per_second : of a video, as its file says; else None
    """

    frames: Iterator[np.ndarray]
    count: int | None = None
    background: np.ndarray | None = None
    live: bool = False
    frames_per_second: float | None = None


def open_source(
    text: str, scene: Scene, *, split: str = "all", fitting: Fitting | None = None, progress: bool = False
) -> Source:
    """The source that `text` names: a file .h5, another file (a video), a folder, `camera:N` or /dev/videoN.

    fitting : how frames of other sizes become the sensor's; None: they are refused
    Raises SourceError, DatasetError or ImportFailure, in one line, where there are no frames of this scene.
    """
    if text.startswith((CAMERA, DEVICES)):
        _require_photographs(scene.sensor, text)
        return Source(_fitted(_camera(text), scene, text, fitting), live=True)
    path = Path(text)
    if path.suffix.lower() in DATASETS:
        data = read(path, scene, progress=progress)
        index = split_indices(data, split, path)
        return Source((data.frames[k] for k in index), len(index), data.background)
    if path.is_dir():
        return _folder(path, scene, fitting)
    if not path.is_file():
        raise SourceError(f"{path}: no such file or folder")
    _require_photographs(scene.sensor, text)
    video = Video(path)
    frames = _fitted(iter(video), scene, text, fitting)
    return Source(frames, frames_per_second=video.frames_per_second())


def _are_photographs(sensor: Sensor) -> bool:
    """Whether the sensor sends what videos, cameras and photographs have: B, G, R."""
    return sensor.channels == "bgr" and sensor.frames == "channels"


def _require_photographs(sensor: Sensor, name: str) -> None:
    """Raise SourceError where the sensor sends something else than what a video or a camera gives."""
    if not _are_photographs(sensor):
        wanted = "RAW10 images" if sensor.frames != "channels" else ", ".join(sensor.channel_names)
        raise SourceError(f"{name}: gives B, G, R: the scene's sensor sends {wanted}")


def _fitted(
    frames: Iterator[np.ndarray], scene: Scene, name: str, fitting: Fitting | None
) -> Iterator[np.ndarray]:
    """Frames of a video or a camera as the sensor's."""
    return (fitted(frame, scene.sensor, f"{name}: frame {k}", fitting) for k, frame in enumerate(frames))


def _camera(text: str) -> Iterator[np.ndarray]:
    """Frames of a camera through OpenCV. Never tried on a camera."""
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # what it has to say is said below
    number = text.removeprefix(CAMERA)
    camera = cv2.VideoCapture(int(number) if number.isdecimal() else number)
    if not camera.isOpened():
        raise SourceError(f"{text}: no such camera, or it is in use")

    def frames() -> Iterator[np.ndarray]:
        try:
            while True:
                there, frame = camera.read()
                if not there:
                    return
                yield frame
        finally:
            camera.release()

    return frames()


def _folder(folder: Path, scene: Scene, fitting: Fitting | None) -> Source:
    """Frame files of a folder in the order of the numbers in their names (sensor/importers/cnc_frames.py).

    Where the sensor sends B, G, R, photographs of any kind count, and are fitted.
    """
    sensor = scene.sensor
    photographs = PHOTOGRAPHS if _are_photographs(sensor) else ()
    suffixes = tuple(dict.fromkeys((*SUFFIXES[sensor.frames], *photographs)))
    files = [
        file
        for file in folder.iterdir()
        if file.suffix.lower() in suffixes and not file.name.endswith(".nir.png") and file.name[0] != "."
    ]
    known: dict[str, Path] = {}
    for file in sorted(files, key=by_number):
        if file.stem not in known or file.suffix == ".npy":  # as CncFrames, which looks for arrays first
            known[file.stem] = file
    if not [stem for stem in known if stem != BACKGROUND]:
        raise SourceError(f"{folder}: no frames: expected files of {', '.join(suffixes)}")
    reader = CncFrames(folder, sensor)

    def frame(stem: str) -> np.ndarray:
        if known[stem].suffix.lower() in photographs:
            path = file_in(folder, known[stem].name)
            return fitted(photograph(path), sensor, str(path), fitting)
        return as_channels(reader.read(stem), sensor)

    background = frame(BACKGROUND) if BACKGROUND in known else None
    names = [stem for stem in known if stem != BACKGROUND]
    return Source(map(frame, names), len(names), background)
