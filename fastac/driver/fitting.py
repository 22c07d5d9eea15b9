"""Frames of another size than the sensor's, resampled as the importers resample photographs.

An importer keeps the middle of a photograph and its aspect, averages areas, and fills what lies beside it
from the background (sensor/importers/resample.py). Datasets and bundles say how large the photographs were:
frames of a video or a camera of that size become what the sensor's models were trained on.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes.sensor_schema import Sensor

if TYPE_CHECKING:
    from fastac.sensor.importers.resample import Resampling


class SourceError(ValueError):
    """A source without frames that the hardware takes; the message is one line."""


@dataclass(frozen=True, eq=False)
class Fitting:
    """How frames of another size become the sensor's.

    background : (H, W, 3) uint8, the bundle's; its rim lies beside frames of another aspect
    photograph_px : height and width of the photographs that the dataset was imported from, where known
    any_size : fit frames of any size; else only those of `photograph_px`
    """

    background: np.ndarray
    photograph_px: tuple[int, int] | None = None
    any_size: bool = False
    _known: dict[tuple[int, int], tuple["Resampling", np.ndarray]] = field(default_factory=dict, repr=False)

    def takes(self, height: int, width: int) -> bool:
        return self.any_size or (height, width) == self.photograph_px

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """A frame (height, width, 3) uint8 as the sensor's, (H, W, 3) uint8."""
        from fastac.sensor.importers.resample import Resampling  # SciPy, which most streams do without

        size = frame.shape[:2]
        if size not in self._known:
            resampling = Resampling(*size, *self.background.shape[:2])
            self._known[size] = resampling, resampling.padding(self.background)
        resampling, padding = self._known[size]
        return np.clip(np.rint(resampling.covered(frame) + padding), 0, 255).astype(np.uint8)


def fitting_of(pipeline: IntegerPipeline, *, any_size: bool = False) -> Fitting:
    """The fitting for a bundle's tables, which say how large the photographs were that it was trained on."""
    size = pipeline.provenance.get("photograph_px")
    is_size = (
        isinstance(size, list | tuple) and len(size) == 2 and all(type(n) is int and n > 0 for n in size)
    )
    return Fitting(pipeline.background, tuple(size) if is_size else None, any_size)


def fitted(frame: np.ndarray, sensor: Sensor, name: str, fitting: Fitting | None) -> np.ndarray:
    """The frame itself where it has the sensor's size, else as `fitting` makes it.

    Raises SourceError, one line that begins with `name`, where there is none for its size.
    """
    want = sensor.height_px, sensor.width_px
    if frame.shape[:2] == want:
        return frame
    if fitting is not None and fitting.takes(*frame.shape[:2]):
        return fitting(frame)
    message = f"{name}: {_size(frame.shape)}: the sensor's frames are {_size(want)}"
    if fitting is not None:
        if fitting.photograph_px is not None:
            message += f", resampled from {_size(fitting.photograph_px)}"
        message += "; --fit resamples others too"
    raise SourceError(message)


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} px"
