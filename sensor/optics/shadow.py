"""Cast shadows: the share of each light source that a point of the skin sees past other parts of the skin.

Light travels through the gel, below the skin. Along the ray from a point to the centre of a source, the
clearance c is the skin's height above the ray; where it is small or negative the skin hides part of the
source. A straight edge at the fraction t of the ray hides the share (1 − c/(s·t))/2 of a source of radius s
with uniform brightness. Of several edges the one that hides most is used:

    visible = clip(1/2 + min c/(2·s·t), 0, 1).
"""

from functools import lru_cache

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import pixel_centres_mm
from fastac.sensor.optics.sources import source_mm
from fastac.store.compiled_loops import compiled

FIRST_PX = 3.0
"""Distance of a ray's first sample: nearer skin is the local slope, whose shading is Lambert's law."""
GROWTH = 1.15
"""Ratio of successive sample distances: far edges cast softer shadows, so coarser samples suffice."""


@lru_cache
def _rays(sensor: Sensor, channel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The rays from all pixels to a channel's source, sampled at S distances.

    Returns the horizontal distance from each pixel to the source (H · W,) in px; the samples' 1/distance (S,)
    in 1/px; the index of the pixel at each sample (H · W, S); and the number of samples of each ray (H · W,).
    Rays end at the image's border, where the housing begins, or at the source.
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


@compiled()
def _visible(depth_mm, source_z_mm, radius_mm, distance_px, inverse_px, index, count):
    """`visible` for all pixels, (H · W,); the last four arguments are those that `_rays` returns."""
    height = depth_mm.astype(np.float32)
    share = np.empty_like(depth_mm)
    for pixel in range(len(height)):
        samples = index[pixel]
        worst = np.float32(0 if count[pixel] < len(samples) else np.inf)
        for i in range(count[pixel]):
            rise = (height[samples[i]] - height[pixel]) * inverse_px[i]
            worst = rise if rise < worst else worst
        # Clearance of the sample that hides most, divided by its fraction t of the ray.
        clearance = worst * distance_px[pixel] + (depth_mm[pixel] - source_z_mm)
        share[pixel] = min(max(0.5 + clearance / (2 * radius_mm), 0.0), 1.0)
    return share


def visible(depth_mm: np.ndarray, sensor: Sensor, channel: str) -> np.ndarray:
    """Share of a channel's source that each pixel of the skin sees, (H, W), 0 to 1.

    `depth_mm` (H, W) is z. A source's radius is `light.softening_mm`, and at least a pixel.
    """
    source_z = source_mm(channel, sensor.light)[2]
    radius = max(sensor.light.softening_mm, sensor.pitch_mm)
    return _visible(depth_mm.ravel(), source_z, radius, *_rays(sensor, channel)).reshape(depth_mm.shape)
