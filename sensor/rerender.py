"""Re-rendering of a dataset's frames with another sensor: other light, coating, markers or camera noise.

The contact mechanics is not solved again: normals and depth are the dataset's ground truth. So two sets of
frames differ only in the property of the sensor that an experiment changes.
"""

from collections.abc import Callable

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.dataset import Dataset
from fastac.sensor.optics.camera import background, render
from fastac.sensor.optics.raw_window import background_raw10, render_raw10


def rerender(data: Dataset, sensor: Sensor, seed: int) -> tuple[np.ndarray, Callable[[int], np.ndarray]]:
    """Return the background frame, and a function from a sample's index to its frame.

    Frames are (H, W, C) uint8 channels or (4H, 4W) uint16 RAW10 images, as `sensor` sends them. `data` must
    hold normals and depth at every pixel; without tangential displacements the markers stay where they are.
    The noise of a sample depends on `seed` and its index only, not on which samples are rendered.
    """
    channels = sensor.frames == "channels"
    view, rest = (render, background) if channels else (render_raw10, background_raw10)

    def draw(sample: int) -> np.ndarray:
        tangential_mm = None if data.tangential_mm is None else data.tangential_mm[sample].astype(np.float64)
        normals, depth_mm = (x[sample].astype(np.float64) for x in (data.normals, data.depth_mm))
        return view(normals, depth_mm, sensor, np.random.default_rng((seed, 1, sample)), tangential_mm)

    return rest(sensor, np.random.default_rng((seed, 0))), draw
