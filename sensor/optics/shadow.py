"""Cast shadows: how much of each source a point of the skin sees past the skin's other parts.

Light travels through the gel, below the skin. From a point towards a source the ray's clearance c is the
skin's height above the ray; what stands above the ray hides the glow from its edge on. A glow of radius s,
seen past an edge at the fraction t of the way, is covered to (1 − c/(s·t))/2 (a straight edge over a source
whose brightness is uniform across it), so that of several edges the worst counts:

    visible = clip(1/2 + min c/(2·s·t), 0, 1).
"""

from functools import lru_cache

import numpy as np
from numba import njit

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import pixel_centres_mm
from fastac.sensor.optics.sources import source_mm

FIRST_PX = 3.0
"""Distance of the first sample: nearer ones are the slope itself, which shades by Lambert's law."""
GROWTH = 1.15
"""Of each sample's distance over the one before: far edges cast softer shadows."""


@lru_cache
def _rays(sensor: Sensor, channel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The way from each pixel to a source (H · W) in px; of S samples along it 1/distance (S,) in 1/px, the
    pixel there (H · W, S), and how many of them (H · W) there are.

    Beyond the image, where the housing is, and beyond the source is none: nothing is in the way there.
    """
    x, y = pixel_centres_mm(sensor)
    height, width = x.shape
    source = source_mm(channel, sensor.light)
    along_x, along_y = source[0] - x, source[1] - y
    distance_px = np.hypot(along_x, along_y) / sensor.pitch_mm
    inverse, index, px = [], [], FIRST_PX
    count, inside = np.zeros(x.shape, int), np.full(x.shape, True)
    while px < distance_px.max():
        fraction = px / distance_px
        v, u = np.indices(x.shape)
        v = np.rint(v + fraction * along_y / sensor.pitch_mm).astype(int)
        u = np.rint(u + fraction * along_x / sensor.pitch_mm).astype(int)
        inside &= (fraction < 1) & (v >= 0) & (v < height) & (u >= 0) & (u < width)
        if not inside.any():
            break
        count += inside
        index.append(np.where(inside, v * width + u, 0).ravel())
        inverse.append(1 / px)
        px *= GROWTH
    index = np.array(index, np.min_scalar_type(height * width)).reshape(-1, height * width)
    inverse = np.array(inverse, np.float32)
    return distance_px.ravel().astype(np.float32), inverse, np.ascontiguousarray(index.T), count.ravel()


@njit(cache=True, nogil=True)
def _visible(depth_mm, source_z_mm, radius_mm, distance_px, inverse_px, index, count):
    """`visible` of (H · W) pixels; `_rays` describes the last four arguments."""
    height = depth_mm.astype(np.float32)
    share = np.empty_like(depth_mm)
    for pixel in range(len(height)):
        samples = index[pixel]
        worst = np.float32(0 if count[pixel] < len(samples) else np.inf)
        for i in range(count[pixel]):
            rise = (height[samples[i]] - height[pixel]) * inverse_px[i]
            worst = rise if rise < worst else worst
        # Of the worst sample, over its fraction of the way.
        clearance = worst * distance_px[pixel] + (depth_mm[pixel] - source_z_mm)
        share[pixel] = min(max(0.5 + clearance / (2 * radius_mm), 0.0), 1.0)
    return share


def visible(depth_mm: np.ndarray, sensor: Sensor, channel: str) -> np.ndarray:
    """Share of a channel's source that each pixel of the skin sees, (H, W), 0 to 1.

    `depth_mm` (H, W) is z. 1 everywhere for a source without extent unless something is in the way.
    """
    source_z = source_mm(channel, sensor.light)[2]
    radius = max(sensor.light.softening_mm, sensor.pitch_mm)
    return _visible(depth_mm.ravel(), source_z, radius, *_rays(sensor, channel)).reshape(depth_mm.shape)
