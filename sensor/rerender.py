"""Frames of presses whose skin is known, seen anew: under other light, with another coat or camera.

No contact is solved: the skin is that of the dataset. What an experiment switches off, noise or dots, is then
all that differs.
"""

from collections.abc import Callable

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.dataset import Dataset
from fastac.sensor.optics.camera import background, render
from fastac.sensor.optics.raw_window import background_raw10, render_raw10


def rerender(data: Dataset, sensor: Sensor, seed: int) -> tuple[np.ndarray, Callable[[int], np.ndarray]]:
    """The background and what draws the frame of any sample, as the sensor gives them: channels or RAW10.

    The dataset knows normals and depth everywhere, and the tangential displacement unless nothing moves.
    Each sample has noise of its own, whichever samples are drawn.
    """
    channels = sensor.frames == "channels"
    view, rest = (render, background) if channels else (render_raw10, background_raw10)

    def draw(sample: int) -> np.ndarray:
        tangential_mm = None if data.tangential_mm is None else data.tangential_mm[sample].astype(np.float64)
        normals, depth_mm = (x[sample].astype(np.float64) for x in (data.normals, data.depth_mm))
        return view(normals, depth_mm, sensor, np.random.default_rng((seed, 1, sample)), tangential_mm)

    return rest(sensor, np.random.default_rng((seed, 0))), draw
