"""Light on the skin from inside the fingertip: four near-field sources and a diffuse share.

The paper puts LEDs of four colours at the four corners of a board behind a translucent skeleton; R and G
shine perpendicular to B and NIR. The skin is Lambertian (Woodham 1979) and is seen from below, so the lit
side's normal is −n. Each source's irradiance falls with distance d as 1/(d² + s²), s the size of the glow
that the skeleton makes of it. Shadows are attached ones only: a slope turned away from a source gets none
of its light; the skin's other parts do not block it.
"""

import numpy as np

from fastac.scene import Light, Sensor
from sensor.geometry import pixel_centres_mm

CORNERS = {"R": (1, 1), "G": (-1, -1), "B": (-1, 1), "NIR": (1, -1)}
"""Signs of x and y of each source: R opposite G, and B opposite NIR on the other diagonal."""


def source_mm(channel: str, light: Light) -> np.ndarray:
    """Position (3,) of a channel's source in mm: below the skin, on a diagonal of the image."""
    side = light.distance_mm / np.sqrt(2)
    return np.array([CORNERS[channel][0] * side, CORNERS[channel][1] * side, -light.below_mm])


def irradiance(normals: np.ndarray, depth_mm: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Light that the skin sends back, per channel of the sensor, (H, W, C) float64 in arbitrary units.

    `normals` (H, W, 3) are outward unit normals, `depth_mm` (H, W) is z. A source that faces a pixel at
    its distance from the image's centre at z = 0 gives it 1 − ambient; the diffuse share gives ambient.
    """
    light = sensor.light
    x, y = pixel_centres_mm(sensor)
    skin = np.stack([x, y, depth_mm], axis=-1)
    reference = light.distance_mm**2 + light.below_mm**2 + light.softening_mm**2
    shares = []
    for channel in sensor.channel_names:
        to_source = source_mm(channel, light) - skin
        distance2 = np.einsum("hwi,hwi->hw", to_source, to_source)
        cosine = -np.einsum("hwi,hwi->hw", to_source, normals) / np.sqrt(distance2)
        falloff = reference / (distance2 + light.softening_mm**2)
        shares.append(light.ambient + (1 - light.ambient) * falloff * np.maximum(cosine, 0))
    return np.stack(shares, axis=-1)
