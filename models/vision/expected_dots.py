"""What a scene alone says of its dots, before there is an image: sizes of windows, where dots should be."""

from functools import lru_cache

import numpy as np

from fastac.models.integer.dot_follower import FRACTION, DotFollower
from fastac.models.integer.dot_windows import BLOCK, CELL, DotWindows
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.optics.marker_grid import marker_pixels

BLUR_PX = 1
"""By how much a dot's image is larger than the dot, on each side."""
CENTRING_PX = CELL / 2
"""How far a dot's centre may be from that of its window, along each axis."""
REACH_SPACINGS = 0.75
"""Largest travel, in spacings of the dots, at which a dot is looked for."""


def bridge_reach(sensor: Sensor) -> int:
    """How far the nearest skin is from a pixel under a dot, in px."""
    return int(np.ceil(sensor.markers.radius_mm / sensor.pitch_mm + BLUR_PX))


def window_half(radius_px: float) -> int:
    """Cells of a window on each side of its middle one."""
    return max(1, int(np.ceil((radius_px + BLUR_PX + CENTRING_PX - CELL / 2) / CELL)))


def window_reach(spacing_px: float) -> int:
    """How far from its place at rest a dot is looked for, in cells."""
    return max(1, int(REACH_SPACINGS * spacing_px / CELL))


@lru_cache
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
    windows = DotWindows(np.full(blocks, 255 * channels), channels, window_half(radius_px), loadable)
    none = np.full((len(places), 2), len(places))
    least, most = np.ones(len(places), np.int64), np.full(len(places), windows.mass_bound)
    rest = np.rint(places * 2**FRACTION).astype(np.int64)
    return DotFollower(windows, rest, none, least, most, window_reach(spacing_px))
