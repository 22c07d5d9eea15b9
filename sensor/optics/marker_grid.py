"""Where the marker dots are: a grid on the undeformed skin, and its image."""

from functools import lru_cache

import numpy as np

from fastac.scenes.sensor_schema import Sensor


@lru_cache
def marker_centres_mm(sensor: Sensor) -> np.ndarray:
    """x and y, (M, 2), of the dots on the undeformed skin, row by row: a centred grid inside the fixed
    rim."""
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
    """Image positions of the dots' centres, (M, 2) as (u, v) in px, on a skin displaced by `tangential_mm`.

    tangential_mm : (H, W, 2), displacement along x and y of the point that is at each pixel of the undeformed
        skin; None for the undeformed skin
    """
    centres = marker_centres_mm(sensor)
    half = np.array([sensor.width_px - 1, sensor.height_px - 1]) / 2
    pixels = centres / sensor.pitch_mm + half
    if tangential_mm is None or not len(centres):
        return pixels
    from scipy.ndimage import map_coordinates  # loaded where skin moves: it takes longer than all else here

    moved = [map_coordinates(tangential_mm[..., k], pixels.T[::-1], order=1) for k in range(2)]
    return pixels + np.stack(moved, axis=-1) / sensor.pitch_mm
