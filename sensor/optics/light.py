"""Light on the skin from inside the fingertip: four near-field sources and a diffuse share.

The paper puts LEDs of four colours at the four corners of a board behind a translucent skeleton; R and G
shine perpendicular to B and NIR. The skin is Lambertian (Woodham 1979) with a specular share, and is seen
from below along z, so the lit side's normal is −n. Each source's irradiance falls with distance d as
1/(d² + s²), s the size of the glow that the skeleton makes of it. A slope turned away from a source gets none
of its light, nor does one that other parts of the skin hide (sensor/optics/shadow.py).
"""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import pixel_centres_mm
from fastac.sensor.optics.shadow import visible
from fastac.sensor.optics.sources import source_mm


def irradiance(normals: np.ndarray, depth_mm: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Light that the skin sends back, per channel of the sensor, (H, W, C) float64 in arbitrary units.

    `normals` (H, W, 3) are outward unit normals, `depth_mm` (H, W) is z. A source that faces a pixel at
    its distance from the image's centre at z = 0 gives it 1 − ambient; the diffuse share gives ambient. The
    specular share follows Blinn (SIGGRAPH 1977): the paint's flakes lie nearly flat, and send light where
    half-way between source and camera is near their normal.
    """
    light = sensor.light
    x, y = (axis.ravel() for axis in pixel_centres_mm(sensor))
    skin = x, y, depth_mm.ravel(), np.ascontiguousarray(np.moveaxis(normals, -1, 0)).reshape(3, -1)
    reference = light.distance_mm**2 + light.below_mm**2 + light.softening_mm**2
    sent = np.empty((len(x), len(sensor.channel_names)))

    def shine(k: int) -> None:
        channel = sensor.channel_names[k]
        source = source_mm(channel, light)
        direct, lobe, falloff = _shine(*skin, source, reference, light.softening_mm**2)
        if light.specular:
            lobe **= light.shininess
        seen = visible(depth_mm, sensor, channel).ravel() if light.cast_shadows else np.ones(len(x))
        _add(direct, lobe, falloff, seen, light.specular, light.ambient, sent[:, k])

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(shine, range(sent.shape[1])))
    return sent.reshape(*depth_mm.shape, -1)


@njit(cache=True, nogil=True)
def _shine(x_mm, y_mm, z_mm, normals, source_mm, reference_mm2, softening_mm2):
    """max(−n · l, 0), max(−n · h, 0) and the decrease with distance of pixels (H · W); normals (3, H · W).

    h is half-way between the unit vectors l to the source and −z to the camera. −n · (l − z) is −n · l, the
    cosine, plus n_z; and |l − z|² is 2 − 2 l_z.
    """
    direct, half_way, falloff = np.empty((3, len(x_mm)))
    for i in range(len(x_mm)):
        way_x, way_y, way_z = source_mm[0] - x_mm[i], source_mm[1] - y_mm[i], source_mm[2] - z_mm[i]
        distance2 = way_x * way_x + way_y * way_y + way_z * way_z
        distance = np.sqrt(distance2)
        along = way_x * normals[0, i] + way_y * normals[1, i] + way_z * normals[2, i]
        direct[i] = max(-along / distance, 0.0)
        half_way[i] = max((normals[2, i] - along / distance) / np.sqrt(2 - 2 * way_z / distance), 0.0)
        falloff[i] = reference_mm2 / (distance2 + softening_mm2)
    return direct, half_way, falloff


@njit(cache=True, nogil=True)
def _add(direct, lobe, falloff, seen, specular, ambient, sent):
    """What the Lambertian, the specular and the diffuse share add up to, into `sent` (H · W)."""
    for i in range(len(sent)):
        mirrored = lobe[i] if direct[i] > 0 else 0.0
        share = (1 - specular) * direct[i] + specular * mirrored
        sent[i] = ambient + (1 - ambient) * (share * falloff[i] * seen[i])
