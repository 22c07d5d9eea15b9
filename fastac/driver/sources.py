"""Where frames come from: a dataset, a video, a folder of photographs or arrays, or a camera.

Each is an iterable of frames (H, W, C) uint8 in the order of the scene's channels. Nothing is scaled: frames
of another size are refused in one line.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.flow.frames import read
from fastac.models.vision.image_processing import as_channels
from fastac.scenes.schema import Scene
from fastac.sensor.importers.cnc_frames import BACKGROUND, SUFFIXES, CncFrames
from fastac.sensor.importers.footage import Video, by_number
from fastac.sensor.samples import split_indices

DATASETS = (".h5", ".hdf5")
CAMERA = "camera:"
DEVICES = "/dev/video"


class SourceError(ValueError):
    """A source without frames that the hardware takes; the message is one line."""


@dataclass(frozen=True)
class Source:
    """Frames, how many there are (None: unknown), and what the untouched sensor sees, where it is known.

    live : frames come when they come: each is to be answered before the next one is asked for
    """

    frames: Iterator[np.ndarray]
    count: int | None = None
    background: np.ndarray | None = None
    live: bool = False


def open_source(text: str, scene: Scene, *, split: str = "all", progress: bool = False) -> Source:
    """The source that `text` names: a file .h5, another file (a video), a folder, `camera:N` or /dev/videoN.

    Raises SourceError, DatasetError or ImportFailure, in one line, where there are no frames of this scene.
    """
    if text.startswith((CAMERA, DEVICES)):
        return Source(_checked(_camera(text), scene, text), live=True)
    path = Path(text)
    if path.suffix.lower() in DATASETS:
        data = read(path, scene, progress=progress)
        index = split_indices(data, split, path)
        return Source((data.frames[k] for k in index), len(index), data.background)
    if path.is_dir():
        return _folder(path, scene)
    if not path.is_file():
        raise SourceError(f"{path}: no such file or folder")
    return Source(_checked(iter(Video(path)), scene, text))


def _checked(frames: Iterator[np.ndarray], scene: Scene, name: str) -> Iterator[np.ndarray]:
    """Frames B, G, R of a video or a camera, if the scene's sensor sees them so."""
    sensor = scene.sensor
    if sensor.channels != "bgr" or sensor.frames != "channels":
        wanted = "RAW10 images" if sensor.frames != "channels" else ", ".join(sensor.channel_names)
        raise SourceError(f"{name}: gives B, G, R: the scene's sensor sends {wanted}")
    shape = sensor.height_px, sensor.width_px, 3

    def each() -> Iterator[np.ndarray]:
        for k, frame in enumerate(frames):
            if frame.shape != shape:
                size, want = (f"{s[1]} x {s[0]} px" for s in (frame.shape, shape))
                raise SourceError(f"{name}: frame {k}: {size}: the sensor's frames are {want}")
            yield frame

    return each()


def _camera(text: str) -> Iterator[np.ndarray]:
    """Frames of a camera through OpenCV. Never tried on a camera."""
    import cv2

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


def _folder(folder: Path, scene: Scene) -> Source:
    """Frame files of a folder in the order of the numbers in their names (sensor/importers/cnc_frames.py)."""
    suffixes = SUFFIXES[scene.sensor.frames]
    files = [
        file
        for file in folder.iterdir()
        if file.suffix in suffixes and not file.name.endswith(".nir.png") and file.name[0] != "."
    ]
    stems = list(dict.fromkeys(file.stem for file in sorted(files, key=by_number)))
    if not [stem for stem in stems if stem != BACKGROUND]:
        raise SourceError(f"{folder}: no frames: expected files of {', '.join(suffixes)}")
    reader = CncFrames(folder, scene.sensor)

    def frame(stem: str) -> np.ndarray:
        return as_channels(reader.read(stem), scene.sensor)

    background = frame(BACKGROUND) if BACKGROUND in stems else None
    names = [stem for stem in stems if stem != BACKGROUND]
    return Source(map(frame, names), len(names), background)
