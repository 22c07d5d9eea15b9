"""Light on the skin from inside the fingertip: four near-field sources and a diffuse share.

The paper puts LEDs of four colours at the four corners of a board behind a translucent skeleton; R and G
shine perpendicular to B and NIR. The skin is Lambertian (Woodham 1979) with a specular share, and is seen
from below along z, so the lit side's normal is −n. Each source's irradiance falls with distance d as
1/(d² + s²), s the size of the glow that the skeleton makes of it. A slope turned away from a source gets none
of its light, nor does one that other parts of the skin hide (sensor/shadow.py).
"""

import numpy as np

from fastac.scene import Sensor
from sensor.geometry import pixel_centres_mm
from sensor.shadow import visible
from sensor.sources import source_mm


def irradiance(normals: np.ndarray, depth_mm: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Light that the skin sends back, per channel of the sensor, (H, W, C) float64 in arbitrary units.

    `normals` (H, W, 3) are outward unit normals, `depth_mm` (H, W) is z. A source that faces a pixel at
    its distance from the image's centre at z = 0 gives it 1 − ambient; the diffuse share gives ambient. The
    specular share follows Blinn (SIGGRAPH 1977): the paint's flakes lie nearly flat, and send light where
    half-way between source and camera is near their normal.
    """
    light = sensor.light
    x, y = pixel_centres_mm(sensor)
    facing = np.ascontiguousarray(np.moveaxis(normals, -1, 0))
    reference = light.distance_mm**2 + light.below_mm**2 + light.softening_mm**2
    shares = []
    for channel in sensor.channel_names:
        to_source = [to - skin for to, skin in zip(source_mm(channel, light), (x, y, depth_mm), strict=True)]
        distance2 = sum(way * way for way in to_source)
        distance = np.sqrt(distance2)
        cosine = -sum(way * share for way, share in zip(to_source, facing, strict=True)) / distance
        direct = np.maximum(cosine, 0)
        if light.specular:
            lobe = _lobe(cosine, facing[2], to_source[2] / distance, light.shininess)
            direct = (1 - light.specular) * direct + light.specular * np.where(cosine > 0, lobe, 0)
        direct *= reference / (distance2 + light.softening_mm**2)
        if light.cast_shadows:
            direct *= visible(depth_mm, sensor, channel)
        shares.append(light.ambient + (1 - light.ambient) * direct)
    return np.stack(shares, axis=-1)


def _lobe(cosine: np.ndarray, normal_z: np.ndarray, source_z: np.ndarray, shininess: float) -> np.ndarray:
    """(−n · h)**shininess, (H, W), h half-way between the unit vectors l to the source and −z to the camera.

    −n · (l − z) is −n · l, the cosine, plus n_z; and |l − z|² is 2 − 2 l_z.
    """
    return np.maximum((cosine + normal_z) / np.sqrt(2 - 2 * source_z), 0) ** shininess
