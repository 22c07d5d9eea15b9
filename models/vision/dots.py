"""From a background frame to the integers that follow its dots: where they are, and how dark they are."""

from dataclasses import replace

import numpy as np

from fastac.models.integer.dot_follower import FRACTION, DotFollower, at_rest
from fastac.models.integer.dot_windows import BLOCK, CELL, DotWindows
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.vision.markers import DetectedDots, MarkerError, associate, skin_brightness
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.optics.skin_paint import marker_pixels

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
    dots, windows = DetectedDots.of_background(background, sensor), windows_of(background, sensor)
    spacing_px = sensor.markers.spacing_mm / sensor.pitch_mm
    if len(dots.rest_px) < 2:
        raise MarkerError("background: 1 dot found: expected 2 or more to follow")
    try:
        return at_rest(windows, background, dots.rest_px, spacing_px=spacing_px, reach=_reach(spacing_px))
    except ValueError as error:
        raise MarkerError(str(error)) from None


def windows_of(background: np.ndarray, sensor: Sensor) -> DotWindows:
    """The windows, with their thresholds of darkness, for a background frame (H, W, C) uint8.

    Raises MarkerError where the sensor has no dots, or the image is not made of whole blocks.
    """
    if sensor.markers is None:
        raise MarkerError("sensor.markers: missing, so there are no dots")
    height, width, channels = background.shape
    if height % BLOCK or width % BLOCK:
        raise MarkerError(f"image of {height} × {width} px: expected multiples of {BLOCK} to follow dots")
    radius_px = sensor.markers.radius_mm / sensor.pitch_mm
    bright = skin_brightness(background.sum(axis=-1, dtype=np.float32), 2 * radius_px)
    blocks = bright.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))
    threshold = np.rint(DARK_SHARE * blocks).astype(np.int64)
    try:
        return DotWindows(threshold, channels, _half(radius_px))
    except ValueError as error:
        raise MarkerError(str(error)) from None


def bridge_of(background: np.ndarray, sensor: Sensor) -> SlopeBridge:
    """The bridge over the dots of frames with this background (H, W, C) uint8: half a dot's image wide."""
    return SlopeBridge(windows_of(background, sensor), bridge_reach(sensor))


def bridge_reach(sensor: Sensor) -> int:
    """How far the nearest skin is from a pixel under a dot, in px."""
    return int(np.ceil(sensor.markers.radius_mm / sensor.pitch_mm + BLUR_PX))


def _half(radius_px: float) -> int:
    """Cells of a window on each side of its middle one."""
    return max(1, int(np.ceil((radius_px + BLUR_PX + CENTRING_PX - CELL / 2) / CELL)))


def _reach(spacing_px: float) -> int:
    return max(1, int(REACH_SPACINGS * spacing_px / CELL))


def expected_follower(sensor: Sensor, *, loadable: bool = False) -> DotFollower:
    """What would follow the dots where the scene's virtual fingertip has them, whatever their darkness.

    From it follow latencies and widths of the hardware before there is a background frame; `loadable`: of
    hardware that may be loaded with other dots.
    """
    dots, pitch_mm = sensor.markers, sensor.pitch_mm
    radius_px, spacing_px = dots.radius_mm / pitch_mm, dots.spacing_mm / pitch_mm
    places = marker_pixels(sensor)
    channels = len(sensor.channel_names)
    blocks = (sensor.height_px // BLOCK, sensor.width_px // BLOCK)
    windows = DotWindows(np.full(blocks, 255 * channels), channels, _half(radius_px), loadable)
    none = np.full((len(places), 2), len(places))
    least, most = np.ones(len(places), np.int64), np.full(len(places), windows.mass_bound)
    rest = np.rint(places * 2**FRACTION).astype(np.int64)
    return DotFollower(windows, rest, none, least, most, _reach(spacing_px))


def detected_as(follower: DotFollower, background: np.ndarray, sensor: Sensor) -> DetectedDots:
    """The detector's dots in a background frame (H, W, C) uint8, in the follower's order.

    Raises MarkerError where one of the follower's dots is none of the detector's.
    """
    found = DetectedDots.of_background(background, sensor)
    order = associate(follower.rest * 2.0**-FRACTION, found.rest_px, found.max_step_px / 2)
    if (order < 0).any():
        u, v = follower.rest_px[np.flatnonzero(order < 0)[0]]
        raise MarkerError(f"dot at {u}, {v} px: not detected in the background")
    return replace(found, rest_px=found.rest_px[order])
