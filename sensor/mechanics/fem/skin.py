"""The pressed finite-element skin resampled to the pixels: depth, normals, contact, tangential displacement.

A pixel sees the point of the skin that has moved above it. That point is found by Newton's method on the
displacement fields, which a cubic spline interpolates from the nodes to the pixels. Where the resulting skin
touches the indenter, to within the spline's error, its depth and slopes are set to the indenter's.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import map_coordinates, spline_filter1d

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import deformed_slopes, normals_from_slopes, pixel_centres_mm, rest_depth_at_mm
from fastac.sensor.mechanics.fem.pressed_gel import REMAPPINGS, GelContact
from fastac.sensor.mechanics.indenter import Indenter
from fastac.store.compiled_loops import compiled

ITERATIONS, CLOSE_PX = 5, 1e-3
"""Newton iterations that find which point of the skin lies above a pixel, and the tolerance in px."""
MIN_JACOBIAN = 0.4
"""Lower limit of the Jacobian in Newton's steps: area of the deformed skin over that of the undeformed
one."""
CONTACT_GAP_MM = 3e-3
"""Gap below which a pixel counts as in contact: without sliding, nodes touch to within 2 µm."""
BEYOND_PX = 8
"""Pixels beyond the image to which the splines are continued, so that the spline filter's boundary condition
has no effect inside."""
MIN_CURVATURE_RADIUS_MM = 0.6
"""Smallest radius of curvature of the skin. Between nodes the spline may be off by the sagitta of such a bend
over one element; so a pixel surrounded by contact counts as in contact too if its gap is smaller than
that."""


@dataclass(frozen=True)
class Skin:
    """The pressed skin at the pixels."""

    normals: np.ndarray
    """(H, W, 3) float64, outward unit normals."""
    depth_mm: np.ndarray
    """(H, W) float64, height z."""
    in_contact: np.ndarray
    """(H, W) bool: pixels whose skin touches the indenter."""
    tangential_mm: np.ndarray
    """(H, W, 2) displacement along x and y of the point that is at each pixel of the undeformed skin."""


def skin_of(contact: GelContact, sensor: Sensor, indenter: Indenter, x_mm: float, y_mm: float) -> Skin:
    """The skin in the equilibrium `contact` with an indenter that was placed above (x_mm, y_mm)."""
    x, y = pixel_centres_mm(sensor)
    nodes_x, nodes_y = contact.mesh.skin_mm[0, :, 0], contact.mesh.skin_mm[:, 0, 1]
    pitch = sensor.pitch_mm
    on_rows, on_columns = _onto(tuple(nodes_y), tuple(y[:, 0])), _onto(tuple(nodes_x), tuple(x[0]))
    fields = np.moveaxis(contact.displacement_mm, -1, 0) / pitch
    moved, coefficients = (
        rows @ fields @ columns.T for rows, columns in zip(on_rows, on_columns, strict=True)
    )
    from_v, from_u, sunk_px = _above(coefficients, moved, *np.gradient(moved[:2], axis=(1, 2)))
    from_x, from_y = (from_u - (sensor.width_px - 1) / 2), (from_v - (sensor.height_px - 1) / 2)
    depth = rest_depth_at_mm(sensor, from_x * pitch, from_y * pitch) + sunk_px * pitch
    p, q = deformed_slopes(rest_depth_at_mm(sensor, x, y) - depth, sensor)

    z, ball_p, ball_q = indenter.surface(
        x - x_mm - contact.indenter_displacement_mm[0], y - y_mm - contact.indenter_displacement_mm[1]
    )
    z = z + contact.first_touch_mm + contact.indenter_displacement_mm[2]
    near = depth > z - (nodes_x[1] - nodes_x[0]) ** 2 / (8 * MIN_CURVATURE_RADIUS_MM)
    in_contact = near & _filled(_between_touching(contact, from_v, from_u) | (depth > z - CONTACT_GAP_MM))
    p[in_contact], q[in_contact] = ball_p[in_contact], ball_q[in_contact]
    depth = np.where(in_contact, z, np.minimum(depth, z))
    tangential = np.ascontiguousarray(np.moveaxis(moved[:2], 0, -1)) * pitch
    return Skin(normals_from_slopes(p, q), depth, in_contact, tangential)


@lru_cache
def _onto(nodes_mm: tuple[float, ...], pixels_mm: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Two matrices that act on values at N nodes: (P, N) gives their cubic spline at P evenly spaced pixels,
    (P + 2, N) the coefficients of the uniform cubic B-spline through those, one beyond each end."""
    pitch = (pixels_mm[-1] - pixels_mm[0]) / (len(pixels_mm) - 1)
    beyond = pitch * np.arange(1, BEYOND_PX + 1)
    wide_mm = np.concatenate([pixels_mm[0] - beyond[::-1], pixels_mm, pixels_mm[-1] + beyond])
    values = make_interp_spline(nodes_mm, np.eye(len(nodes_mm)))(wide_mm)
    coefficients = spline_filter1d(values, axis=0, mode="mirror")
    return values[BEYOND_PX:-BEYOND_PX], coefficients[BEYOND_PX - 1 : 1 - BEYOND_PX]


def _filled(mask: np.ndarray) -> np.ndarray:
    """The mask (H, W) with its holes filled: the regions that are not connected to the border."""
    beside = np.pad(mask.astype(np.uint8), 1)
    cv2.floodFill(beside, None, (0, 0), 1)
    return mask | (beside[1:-1, 1:-1] == 0)


def _between_touching(contact: GelContact, from_v: np.ndarray, from_u: np.ndarray) -> np.ndarray:
    """Whether the skin above each pixel, (H, W), lies in an element whose four nodes are in contact.

    from_v, from_u : (H, W), undeformed position of that skin in px; the nodes are evenly spaced over them
    """
    last = [size - 1 for size in contact.in_contact.shape]
    height, width = from_v.shape
    at = [from_v * last[0] / (height - 1), from_u * last[1] / (width - 1)]
    return map_coordinates(contact.in_contact.astype(float), at, order=1, mode="nearest") > 1 - 1e-9


@compiled()
def _above(coefficients, moved, along_v, along_u):
    """Undeformed position v, u of the skin that is above each pixel, and its displacement along z: (H, W)
    each, in px.

    coefficients : (3, H + 2, W + 2), B-spline coefficients of the displacement along x, y, z in px
    moved : (3, H, W), that displacement at the pixels
    along_v, along_u : (2, H, W), derivatives of its x and y components along v and u

    Newton's method with the gradient taken at the pixel, which approximates that at the point. Where it does
    not converge, as where a strong tangential load folds the skin, fixed-point iteration replaces it.
    """
    _, height, width = moved.shape
    from_v, from_u, raised = np.empty((3, height, width))
    for v in range(height):
        for u in range(width):
            vv, vu, uv, uu = along_v[1, v, u], along_u[1, v, u], along_v[0, v, u], along_u[0, v, u]
            area = max((1 + vv) * (1 + uu) - vu * uv, MIN_JACOBIAN)
            off_v, off_u = moved[1, v, u], moved[0, v, u]
            at_v, at_u, z = float(v), float(u), 0.0
            close = False
            for _ in range(ITERATIONS):
                at_v -= ((1 + uu) * off_v - vu * off_u) / area
                at_u -= ((1 + vv) * off_u - uv * off_v) / area
                x, y, z = _spline(coefficients, at_v, at_u)
                off_v, off_u = at_v - v + y, at_u - u + x
                close = np.hypot(off_v, off_u) <= CLOSE_PX
                if close:
                    break
            if not close:
                at_v, at_u = float(v), float(u)
                for _ in range(REMAPPINGS):
                    x, y, z = _spline(coefficients, at_v, at_u)
                    at_v, at_u = v - y, u - x
                _, _, z = _spline(coefficients, at_v, at_u)
            from_v[v, u], from_u[v, u], raised[v, u] = at_v, at_u, z
    return from_v, from_u, raised


@compiled()
def _spline(coefficients, v, u):
    """Values of three uniform cubic B-splines at v, u in px, clipped to the image."""
    _, height, width = coefficients.shape
    v, u = min(max(v, 0.0), height - 3.0), min(max(u, 0.0), width - 3.0)
    top, left = min(int(v), height - 4), min(int(u), width - 4)
    rows, columns = _weights(v - top), _weights(u - left)
    x = y = z = 0.0
    for i in range(4):
        for j in range(4):
            row, column = top + i, left + j
            weight = rows[i] * columns[j]
            x += weight * coefficients[0, row, column]
            y += weight * coefficients[1, row, column]
            z += weight * coefficients[2, row, column]
    return x, y, z


@compiled()
def _weights(t):
    """Weights of four successive B-spline coefficients at the fraction t, 0 to 1, between the middle two."""
    s = 1 - t
    return s * s * s / 6, 2 / 3 - t * t * (2 - t) / 2, 2 / 3 - s * s * (2 - s) / 2, t * t * t / 6
