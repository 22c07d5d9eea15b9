"""From a background frame to the integers that follow its dots: where they are, and how dark they are."""

import numpy as np

from fastac.models.integer.dot_follower import DotFollower, at_rest
from fastac.models.integer.dot_windows import BLOCK, CELL, DotWindows
from fastac.models.vision.markers import Detector, MarkerError, skin_brightness
from fastac.scenes.sensor_schema import Sensor

DARK_SHARE = 0.75
"""Threshold of darkness, as a share of the skin's brightness at rest. Pressing darkens a pixel of the virtual
fingertip's skin below 0.80 of that in one case of a thousand; dots are at 0.2 and below."""
BLUR_PX = 1
"""By how much a dot's image is larger than the dot, on each side."""
CENTRING_PX = CELL / 2
"""How far a dot's centre may be from that of its window, along each axis."""
REACH_SPACINGS = 0.75
"""Largest travel, in spacings of the dots, at which a dot is looked for."""


def follower_of(background: np.ndarray, sensor: Sensor) -> DotFollower:
    """The follower of the dots in a background frame (H, W, C) uint8.

    Windows are the smallest that hold a whole dot. Raises MarkerError where the sensor has no dots, the
    background shows none, or the image is not made of whole blocks.
    """
    if sensor.markers is None:
        raise MarkerError("sensor.markers: missing, so there are no dots to follow")
    height, width, channels = background.shape
    if height % BLOCK or width % BLOCK:
        raise MarkerError(f"image of {height} × {width} px: expected multiples of {BLOCK} to follow dots")
    radius_px, spacing_px = (
        length / sensor.pitch_mm for length in (sensor.markers.radius_mm, sensor.markers.spacing_mm)
    )
    places = Detector(2 * radius_px).detect(background)
    if not len(places):
        raise MarkerError("background: no dot found")
    bright = skin_brightness(background.sum(axis=-1, dtype=np.float32), 2 * radius_px)
    blocks = bright.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))
    threshold = np.rint(DARK_SHARE * blocks).astype(np.int64)
    half = max(1, int(np.ceil((radius_px + BLUR_PX + CENTRING_PX - CELL / 2) / CELL)))
    try:
        windows = DotWindows(threshold, channels, half)
        reach = max(1, int(REACH_SPACINGS * spacing_px / CELL))
        return at_rest(windows, background, places, spacing_px=spacing_px, reach=reach)
    except ValueError as error:
        raise MarkerError(str(error)) from None
