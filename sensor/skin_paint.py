"""What is painted on the skin, and moves with it: the grain of the reflective coat, and the marker dots."""

from functools import lru_cache

import numpy as np
from scipy.ndimage import map_coordinates

from fastac.scene import Sensor


@lru_cache
def grain(sensor: Sensor) -> np.ndarray:
    """The coat's albedo relative to its mean, (H, W): part of the sensor, the same in every frame."""
    pattern = np.random.default_rng(0).standard_normal((sensor.height_px, sensor.width_px))
    return np.maximum(1 + sensor.grain * pattern, 0)


@lru_cache
def marker_centres_mm(sensor: Sensor) -> np.ndarray:
    """x and y (M, 2) of the dots at rest, row by row: a grid about the centre, inside the fixed rim."""
    if sensor.markers is None:
        return np.empty((0, 2))
    lines = []
    for size_px in (sensor.width_px, sensor.height_px):
        reach = (size_px - 1) / 2 * sensor.pitch_mm - sensor.elastomer.rim_mm
        count = max(int(reach // sensor.markers.spacing_mm), 0)
        lines.append(np.arange(-count, count + 1) * sensor.markers.spacing_mm)
    x, y = np.meshgrid(*lines)
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def marker_pixels(sensor: Sensor, tangential_mm: np.ndarray | None = None) -> np.ndarray:
    """Where the dots' centres are seen, (M, 2) as (u, v) in px, of a skin displaced by `tangential_mm`.

    tangential_mm : (H, W, 2), displacement in x and y of the skin that was at each pixel at rest; None: rest
    """
    centres = marker_centres_mm(sensor)
    half = np.array([sensor.width_px - 1, sensor.height_px - 1]) / 2
    pixels = centres / sensor.pitch_mm + half
    if tangential_mm is None or not len(centres):
        return pixels
    moved = [map_coordinates(tangential_mm[..., k], pixels.T[::-1], order=1) for k in range(2)]
    return pixels + np.stack(moved, axis=-1) / sensor.pitch_mm


def albedo(sensor: Sensor, tangential_mm: np.ndarray | None = None) -> np.ndarray:
    """The skin's albedo at each pixel, (H, W), of a skin displaced by `tangential_mm` as in `marker_pixels`.

    The grain is looked up where each pixel's skin came from, to first order in the displacement. Dots keep
    their shape, and a pixel at a dot's edge is dark by the share of it that the dot covers.
    """
    paint = grain(sensor)
    if tangential_mm is not None:
        v, u = np.indices(paint.shape)
        from_u, from_v = (index - tangential_mm[..., k] / sensor.pitch_mm for k, index in enumerate((u, v)))
        paint = map_coordinates(paint, [from_v, from_u], order=1, mode="nearest")
    if sensor.markers is None:
        return paint
    return paint * (1 - sensor.markers.contrast * coverage(sensor, marker_pixels(sensor, tangential_mm)))


def coverage(sensor: Sensor, pixels: np.ndarray) -> np.ndarray:
    """Share of each pixel that the dots at `pixels` (M, 2) cover, (H, W)."""
    radius = sensor.markers.radius_mm / sensor.pitch_mm
    covered = np.zeros((sensor.height_px, sensor.width_px))
    window = int(np.ceil(radius + 1))
    offsets = np.arange(-window, window + 1)
    columns, rows = (np.rint(pixels[:, k]).astype(int)[:, None] + offsets for k in range(2))
    dx, dy = columns - pixels[:, :1], rows - pixels[:, 1:]
    distance = np.hypot(dx[:, None, :], dy[:, :, None])  # (M, rows, columns)
    share = np.clip(radius - distance + 0.5, 0, 1)
    v, u = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
    seen = (v >= 0) & (v < sensor.height_px) & (u >= 0) & (u < sensor.width_px)
    np.maximum.at(covered, (v[seen], u[seen]), share[seen])
    return covered
