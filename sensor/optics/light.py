"""Illumination of the skin from inside the fingertip, for photometric stereo: near-field sources plus
ambient.

The paper has LEDs of four colours at the four corners of a board behind a translucent skeleton; R and G shine
perpendicular to B and NIR. The skin reflects as a Lambertian surface (Woodham, MIT AI memo 1979) with a
specular share. It is seen from below along z, so the normal of its lit side is −n. A source's irradiance
falls with distance d as 1/(d² + s²), with s the radius of the glow that the skeleton spreads it to. A surface
that is turned away from a source gets none of its light, and cast shadows less (sensor/optics/shadow.py).
"""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import pixel_centres_mm
from fastac.sensor.optics.shadow import visible
from fastac.sensor.optics.sources import source_mm
from fastac.store.compiled_loops import compiled


def irradiance(normals: np.ndarray, depth_mm: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Light reflected to the camera, per channel of the sensor, (H, W, C) float64 in arbitrary units.

    `normals` (H, W, 3) are outward unit normals, `depth_mm` (H, W) is z. The unit is such that ambient light
    contributes `light.ambient`, and a source 1 − ambient to a Lambertian pixel that faces it at its distance
    from the image's centre at z = 0. The specular share is Blinn's (SIGGRAPH 1977): max(−n · h, 0) to the
    power `light.shininess`, with h half-way between the directions to source and camera.
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


@compiled()
def _shine(x_mm, y_mm, z_mm, normals, source_mm, reference_mm2, softening_mm2):
    """max(−n · l, 0), max(−n · h, 0) and the falloff with distance, (H · W) each; normals are (3, H · W).

    l is the unit vector to the source, −z that to the camera, and h = (l − z) / |l − z|. Here −n · (l − z) is
    −n · l, the cosine, plus n_z; and |l − z|² is 2 − 2 l_z.
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


@compiled()
def _add(direct, lobe, falloff, seen, specular, ambient, sent):
    """Write the sum of the Lambertian, the specular and the ambient light of every pixel into `sent` (H ·
    W)."""
    for i in range(len(sent)):
        mirrored = lobe[i] if direct[i] > 0 else 0.0
        share = (1 - specular) * direct[i] + specular * mirrored
        sent[i] = ambient + (1 - ambient) * (share * falloff[i] * seen[i])
