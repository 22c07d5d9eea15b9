"""The pressed skin of the finite-element gel at the pixels: depth, normals, contact, tangential displacement.

A pixel sees the point of the skin that has moved above it. Which one that is follows from the displacement by
iteration, on fields that the nodes' cubic spline gives at every pixel. Where the skin so found lies on the
indenter, to within the spline's error, its depth and slopes are the indenter's own.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import binary_fill_holes, map_coordinates, spline_filter

from fastac.scene import Sensor
from sensor.gel_contact import REMAPPINGS, GelContact
from sensor.geometry import normals_from_slopes, pixel_centres_mm, rest_depth_at_mm
from sensor.indenter import Indenter
from sensor.layer_rig import slopes_less

ITERATIONS, CLOSE_PX = 5, 1e-3
"""Of Newton's method, to find which point of the skin lies above a pixel, and how near it has to come."""
LEAST_AREA = 0.4
"""Area of compressed skin over that at rest that Newton's steps reckon with, at least."""
TOUCHING_MM = 3e-3
"""Gap below which a pixel counts as touching: nodes touch to 2 µm where nothing slides."""
SHARPEST_MM = 0.6
"""Radius of the skin's sharpest bend. The spline between nodes may miss a bend's sagitta over an element:
pixels between nodes or pixels that touch do too if their gap is less."""


@dataclass(frozen=True)
class Skin:
    normals: np.ndarray
    """(H, W, 3) float64."""
    depth_mm: np.ndarray
    """(H, W) float64."""
    touching: np.ndarray
    """(H, W) bool."""
    tangential_mm: np.ndarray
    """(H, W, 2) displacement in x and y of the skin that is at each pixel at rest."""


def skin_of(contact: GelContact, sensor: Sensor, indenter: Indenter, x_mm: float, y_mm: float) -> Skin:
    """The skin after `indenter`, led down at x_mm, y_mm, made `contact`."""
    x, y = pixel_centres_mm(sensor)
    nodes_x, nodes_y = contact.mesh.skin_mm[0, :, 0], contact.mesh.skin_mm[:, 0, 1]
    moved = np.stack(
        [
            RectBivariateSpline(nodes_y, nodes_x, contact.displacement_mm[..., axis])(y[:, 0], x[0])
            for axis in range(3)
        ],
        axis=-1,
    )
    from_v, from_u = _sources(moved[..., :2] / sensor.pitch_mm)
    sunk = map_coordinates(moved[..., 2], [from_v, from_u], order=3, mode="nearest")
    from_x, from_y = (from_u - (sensor.width_px - 1) / 2), (from_v - (sensor.height_px - 1) / 2)
    rest = rest_depth_at_mm(sensor, from_x * sensor.pitch_mm, from_y * sensor.pitch_mm)
    depth = rest + sunk
    p, q = slopes_less(rest_depth_at_mm(sensor, x, y) - depth, sensor)

    z, ball_p, ball_q = indenter.surface(x - x_mm - contact.way_mm[0], y - y_mm - contact.way_mm[1])
    z = z + contact.first_touch_mm + contact.way_mm[2]
    near = depth > z - (nodes_x[1] - nodes_x[0]) ** 2 / (8 * SHARPEST_MM)
    touching = near & binary_fill_holes(
        _between_touching(contact, from_v, from_u) | (depth > z - TOUCHING_MM)
    )
    p[touching], q[touching] = ball_p[touching], ball_q[touching]
    depth = np.where(touching, z, np.minimum(depth, z))
    return Skin(normals_from_slopes(p, q), depth, touching, moved[..., :2])


def _between_touching(contact: GelContact, from_v: np.ndarray, from_u: np.ndarray) -> np.ndarray:
    """Whether the skin above each pixel, (H, W), lies in an element whose four nodes touch; nodes span the
    pixels' centres evenly."""
    last = [size - 1 for size in contact.touching.shape]
    height, width = from_v.shape
    at = [from_v * last[0] / (height - 1), from_u * last[1] / (width - 1)]
    return map_coordinates(contact.touching.astype(float), at, order=1, mode="nearest") > 1 - 1e-9


def _sources(moved_px: np.ndarray) -> np.ndarray:
    """v and u (2, H, W) at rest of the skin that is above each pixel, from the displacement (H, W, 2) in px.

    Newton's method with the gradient at the pixel itself, which is near enough to that at the point; but
    where a strong drag folds the skin, the plain iteration.
    """
    shape, moved = moved_px.shape[:2], moved_px.reshape(-1, 2)[:, ::-1].T
    gradient = np.array([np.gradient(moved_px[..., k]) for k in (1, 0)]).reshape(2, 2, -1)
    (vv, vu), (uv, uu) = gradient
    determinant = np.maximum((1 + vv) * (1 + uu) - vu * uv, LEAST_AREA)
    inverse = np.array([[1 + uu, -vu], [-uv, 1 + vv]]) / determinant
    splines = [spline_filter(moved_px[..., k], mode="nearest") for k in (1, 0)]
    pixel = np.indices(shape, dtype=float).reshape(2, -1)
    found = pixel - np.einsum("abn,bn->an", inverse, moved)
    left = np.arange(pixel.shape[1])

    def off_px(at: np.ndarray, target: np.ndarray) -> np.ndarray:
        keys = {"order": 3, "mode": "nearest", "prefilter": False}
        return at - target + np.array([map_coordinates(spline, at, **keys) for spline in splines])

    for _ in range(ITERATIONS):
        off = off_px(found[:, left], pixel[:, left])
        far = np.hypot(*off) > CLOSE_PX
        left, off = left[far], off[:, far]
        found[:, left] -= np.einsum("abn,bn->an", inverse[..., left], off)
    found[:, left] = pixel[:, left]
    for _ in range(REMAPPINGS if len(left) else 0):
        found[:, left] -= off_px(found[:, left], pixel[:, left])
    return found.reshape(2, *shape)
