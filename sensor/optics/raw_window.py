"""RAW10 frames of the virtual sensor: the window of the camera's image with 4 × 4 raw pixels per pixel.

Illumination and paint grain are computed per pixel and interpolated linearly to raw pixels; marker dots are
drawn at the resolution of the raw pixels.
"""

import cv2
import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import normals_from_slopes, rest_depth_mm, rest_slopes
from fastac.sensor.optics.camera import BACKGROUND_EXPOSURES, noise_free_image
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.sensor.optics.mosaic import CELL
from fastac.sensor.optics.raw_camera import MAXIMUM, RawCamera
from fastac.sensor.optics.skin_paint import coverage


def raw_camera(sensor: Sensor) -> RawCamera:
    """The camera with the parameters of the scene's `sensor.raw10`."""
    keys = ("crosstalk", "black_level_dn", "electrons_per_dn", "read_noise_dn", "vignetting", "dead_share")
    return RawCamera(**{key: getattr(sensor.raw10, key) for key in keys})


def window_light(
    normals: np.ndarray, depth_mm: np.ndarray, sensor: Sensor, tangential_mm: np.ndarray | None = None
) -> np.ndarray:
    """Scene-linear light B, G, R, NIR, (4H, 4W, 4) float32, of a skin; parameters as of `camera.render`.

    All four channels are rendered even if the scene keeps three: the filter array has NIR pixels, and NIR
    crosstalk reaches the visible ones.
    """
    plain = sensor.model_copy(update={"channels": "bgr+nir", "markers": None})
    light = noise_free_image(normals, depth_mm, plain, tangential_mm).astype(np.float32)
    size = sensor.width_px * CELL, sensor.height_px * CELL
    window = cv2.resize(light, size, interpolation=cv2.INTER_LINEAR) * np.float32(sensor.raw10.exposure / 255)
    if sensor.markers is not None:
        # A copy is not validated: the schema bounds what is processed, and the window is four times as fine.
        fine = {"height_px": size[1], "width_px": size[0], "pitch_mm": sensor.pitch_mm / CELL}
        dots = marker_pixels(sensor, tangential_mm) * CELL + (CELL - 1) / 2
        covered = coverage(sensor.model_copy(update=fine), dots).astype(np.float32)
        window *= (1 - np.float32(sensor.markers.contrast) * covered)[..., None]
    return np.maximum(window, 0)


def render_raw10(
    normals: np.ndarray,
    depth_mm: np.ndarray,
    sensor: Sensor,
    rng: np.random.Generator,
    tangential_mm: np.ndarray | None = None,
) -> np.ndarray:
    """One RAW10 image (4H, 4W) uint16; see `window_light`."""
    return raw_camera(sensor).expose(window_light(normals, depth_mm, sensor, tangential_mm), rng)


def background_raw10(sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """The background, (4H, 4W) uint16: the rounded mean of BACKGROUND_EXPOSURES images of the undeformed
    skin.

    Dead and hot pixels are included.
    """
    camera = raw_camera(sensor)
    light = window_light(normals_from_slopes(*rest_slopes(sensor)), rest_depth_mm(sensor), sensor)
    images = [camera.expose(light, rng) for _ in range(BACKGROUND_EXPOSURES)]
    return np.minimum(np.rint(np.mean(images, axis=0)), MAXIMUM).astype(np.uint16)
