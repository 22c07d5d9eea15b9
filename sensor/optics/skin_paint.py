"""The paint on the skin, which moves with it: the grain of the reflective coating, and the marker dots."""

from functools import lru_cache

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.store.compiled_loops import compiled


@lru_cache
def grain(sensor: Sensor) -> np.ndarray:
    """The coating's albedo relative to its mean, (H, W): a fixed pattern of the sensor, the same in all
    frames."""
    pattern = np.random.default_rng(0).standard_normal((sensor.height_px, sensor.width_px))
    return np.maximum(1 + sensor.grain * pattern, 0)


def albedo(sensor: Sensor, tangential_mm: np.ndarray | None = None) -> np.ndarray:
    """The skin's albedo at each pixel, (H, W), of a skin displaced by `tangential_mm` as in `marker_pixels`.

    The grain is sampled at the undeformed position of each pixel's skin, to first order in the displacement.
    Dots keep their shape; a pixel at a dot's edge is darkened in proportion to the area that the dot covers.
    """
    paint = grain(sensor)
    if tangential_mm is not None:
        paint = _moved(paint, tangential_mm / sensor.pitch_mm)
    if sensor.markers is None:
        return paint
    return paint * (1 - sensor.markers.contrast * coverage(sensor, marker_pixels(sensor, tangential_mm)))


@compiled()
def _moved(image: np.ndarray, moved_px: np.ndarray) -> np.ndarray:
    """An image (H, W) warped by the displacement `moved_px` (H, W, 2), x and y; bilinear, edges repeated.

    Equal to scipy.ndimage.map_coordinates of order 1, value for value, and six times as fast.
    """
    height, width = image.shape
    found = np.empty_like(image)
    for v in range(height):
        for u in range(width):
            from_v, from_u = v - moved_px[v, u, 1], u - moved_px[v, u, 0]
            down, right = from_v - np.floor(from_v), from_u - np.floor(from_u)
            upper, lower = _pair(int(np.floor(from_v)), height)
            left, right_of = _pair(int(np.floor(from_u)), width)
            found[v, u] = (
                image[upper, left] * (1 - down) * (1 - right)
                + image[upper, right_of] * (1 - down) * right
                + image[lower, left] * down * (1 - right)
                + image[lower, right_of] * down * right
            )
    return found


@compiled()
def _pair(index: int, size: int) -> tuple[int, int]:
    """An index and the next one, both clipped to 0 … size − 1."""
    return min(max(index, 0), size - 1), min(max(index + 1, 0), size - 1)


def coverage(sensor: Sensor, pixels: np.ndarray) -> np.ndarray:
    """Share of each pixel that the dots at `pixels` (M, 2) cover, (H, W)."""
    covered = np.zeros((sensor.height_px, sensor.width_px))
    _cover(covered, pixels, sensor.markers.radius_mm / sensor.pitch_mm)
    return covered


@compiled()
def _cover(covered, pixels, radius_px):
    height, width = covered.shape
    reach = int(np.ceil(radius_px + 1))
    for centre_u, centre_v in pixels:
        column, row = int(np.rint(centre_u)), int(np.rint(centre_v))
        for v in range(max(row - reach, 0), min(row + reach + 1, height)):
            for u in range(max(column - reach, 0), min(column + reach + 1, width)):
                share = radius_px - np.hypot(u - centre_u, v - centre_v) + 0.5
                covered[v, u] = max(covered[v, u], min(share, 1.0))
