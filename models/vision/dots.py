"""From a background frame to the integers that follow its dots: where they are, and how dark they are."""

from dataclasses import replace

import numpy as np

from fastac.models.integer.dot_follower import FRACTION, DotFollower, at_rest
from fastac.models.integer.dot_windows import BLOCK, DotWindows
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.vision.expected_dots import bridge_reach, window_half, window_reach
from fastac.models.vision.markers import DetectedDots, MarkerError, associate, skin_brightness
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor

DARK_SHARE = 0.75
"""Threshold of darkness, as a share of the skin's brightness at rest. Pressing darkens a pixel of the virtual
fingertip's skin below 0.80 of that in one case of a thousand; dots are at 0.2 and below."""


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
        return at_rest(
            windows, background, dots.rest_px, spacing_px=spacing_px, reach=window_reach(spacing_px)
        )
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
        return DotWindows(threshold, channels, window_half(radius_px))
    except ValueError as error:
        raise MarkerError(str(error)) from None


def bridge_of(background: np.ndarray, sensor: Sensor) -> SlopeBridge:
    """The bridge over the dots of frames with this background (H, W, C) uint8: half a dot's image wide."""
    return SlopeBridge(windows_of(background, sensor), bridge_reach(sensor))


def slope_bridge(background: np.ndarray, scene: Scene) -> SlopeBridge | None:
    """As `bridge_of`; None where the scene wants no bridge."""
    return bridge_of(background, scene.sensor) if scene.wants_bridge else None


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
