"""The camera of the virtual sensor: gain, photon and read noise, 8-bit digital numbers (DN)."""

from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import normals_from_slopes, rest_depth_mm, rest_slopes
from fastac.sensor.optics.light import irradiance
from fastac.sensor.optics.skin_paint import albedo
from fastac.store.compiled_loops import compiled

BACKGROUND_EXPOSURES = 16
"""Number of no-contact frames averaged into a background, to reduce its noise."""


@lru_cache
def _gain(sensor: Sensor) -> np.ndarray:
    """Digital numbers per unit of irradiance, one gain per channel, (C,)."""
    at_rest = irradiance(normals_from_slopes(*rest_slopes(sensor)), rest_depth_mm(sensor), sensor)
    return sensor.light.brightest_dn / at_rest.max(axis=(0, 1))


def noise_free_image(
    normals: np.ndarray, depth_mm: np.ndarray, sensor: Sensor, tangential_mm: np.ndarray | None = None
) -> np.ndarray:
    """The noise-free image in digital numbers, (H, W, C) float64, not yet clipped to 8 bits.

    Each channel's gain brings the brightest pixel of the undeformed, unpainted skin to
    `sensor.light.brightest_dn`. The paint's albedo then scales all channels alike; it moves with the skin by
    `tangential_mm` (H, W, 2), see sensor/optics/skin_paint.py.
    """
    return _gain(sensor) * irradiance(normals, depth_mm, sensor) * albedo(sensor, tangential_mm)[..., None]


def _expose(image: np.ndarray, sensor: Sensor, normal: np.ndarray) -> np.ndarray:
    """One exposure (H, W, C) uint8 of a noise-free image (H, W, C) in DN: photon noise, read noise, rounding.

    normal : (H, W, C), samples of the standard normal distribution
    The variance is noise_dn² + DN / electrons_per_dn.
    """
    return _noisy(image, normal, float(sensor.noise_dn), float(sensor.electrons_per_dn))


@compiled()
def _noisy(image, normal, read_dn, electrons_per_dn):
    exposed = np.empty(image.shape, np.uint8)
    for i, mean in enumerate(image.flat):
        deviation = np.sqrt(read_dn**2 + max(mean, 0.0) / electrons_per_dn)
        exposed.flat[i] = min(max(np.rint(mean + deviation * normal.flat[i]), 0.0), 255.0)
    return exposed


def render(
    normals: np.ndarray,
    depth_mm: np.ndarray,
    sensor: Sensor,
    rng: np.random.Generator,
    tangential_mm: np.ndarray | None = None,
) -> np.ndarray:
    """One frame (H, W, C) uint8 of a skin with outward unit normals (H, W, 3) and z = depth_mm (H, W).

    Channels are the sensor's, in its order. The paint has moved by `tangential_mm` (H, W, 2), along x and y.
    See `_expose` for the noise.
    """
    shape = (*depth_mm.shape, len(sensor.channel_names))
    with ThreadPoolExecutor(1) as beside:
        normal = beside.submit(rng.standard_normal, shape)
        image = noise_free_image(normals, depth_mm, sensor, tangential_mm)
    return _expose(image, sensor, normal.result())


def background(sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """The background, (H, W, C) uint8: the rounded mean of BACKGROUND_EXPOSURES frames of the undeformed
    skin."""
    image = noise_free_image(normals_from_slopes(*rest_slopes(sensor)), rest_depth_mm(sensor), sensor)
    frames = [_expose(image, sensor, rng.standard_normal(image.shape)) for _ in range(BACKGROUND_EXPOSURES)]
    return np.rint(np.mean(frames, axis=0)).astype(np.uint8)
