"""Cast shadows: how much of each source a point of the skin sees past the skin's other parts.

Light travels through the gel, below the skin. From a point towards a source the ray's clearance c is the
skin's height above the ray; what stands above the ray hides the glow from its edge on. A glow of radius s,
seen past an edge at the fraction t of the way, is covered to (1 − c/(s·t))/2 (a straight edge over a source
whose brightness is uniform across it), so that of several edges the worst counts:

    visible = clip(1/2 + min c/(2·s·t), 0, 1).
"""

from functools import lru_cache

import numpy as np

from fastac.scene import Sensor
from sensor.geometry import pixel_centres_mm
from sensor.sources import source_mm

FIRST_PX = 3.0
"""Distance of the first sample: nearer ones are the slope itself, which shades by Lambert's law."""
GROWTH = 1.15
"""Of each sample's distance over the one before: far edges cast softer shadows."""


@lru_cache
def _rays(sensor: Sensor, channel: str) -> tuple[np.ndarray, list[tuple[np.float32, np.ndarray]]]:
    """Distance to a source (H, W) in px; and of each sample along the rays 1/distance in 1/px, pixel indices.

    Beyond the image, where the housing is, and beyond the source the index is the point's own: nothing is in
    the way there.
    """
    x, y = pixel_centres_mm(sensor)
    height, width = x.shape
    own = np.arange(height * width).reshape(height, width)
    source = source_mm(channel, sensor.light)
    along_x, along_y = source[0] - x, source[1] - y
    distance_px = np.hypot(along_x, along_y) / sensor.pitch_mm
    rays, px = [], FIRST_PX
    while px < distance_px.max():
        fraction = px / distance_px
        v, u = np.indices(x.shape)
        v = np.rint(v + fraction * along_y / sensor.pitch_mm).astype(int)
        u = np.rint(u + fraction * along_x / sensor.pitch_mm).astype(int)
        inside = (fraction < 1) & (v >= 0) & (v < height) & (u >= 0) & (u < width)
        if not inside.any():
            break
        index = np.where(inside, v * width + u, own)
        rays.append((np.float32(1 / px), index))
        px *= GROWTH
    return distance_px.astype(np.float32), rays


def visible(depth_mm: np.ndarray, sensor: Sensor, channel: str) -> np.ndarray:
    """Share of a channel's source that each pixel of the skin sees, (H, W), 0 to 1.

    `depth_mm` (H, W) is z. 1 everywhere for a source without extent unless something is in the way.
    """
    source_z = source_mm(channel, sensor.light)[2]
    radius = max(sensor.light.softening_mm, sensor.pitch_mm)
    height = depth_mm.astype(np.float32)
    worst, rise = np.full_like(height, np.inf), np.empty_like(height)
    distance_px, rays = _rays(sensor, channel)
    for inverse, index in rays:
        # No index is outside: any mode but "raise" only saves the check, and the copy it makes.
        np.take(height, index, out=rise, mode="wrap")
        rise -= height
        rise *= inverse
        np.minimum(worst, rise, out=worst)
    # Of the worst sample, over its fraction of the way.
    clearance = worst * distance_px + (depth_mm - source_z)
    return np.clip(0.5 + clearance / (2 * radius), 0, 1)
