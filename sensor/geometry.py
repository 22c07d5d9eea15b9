"""Geometry of the undeformed skin: depth and slopes at the pixels, and the normals of slopes.

`z` is the skin's height away from the camera, in mm; pressing lowers it. Image column u runs along x,
row v along y; the origin of x and y is the centre of the image. Slopes are p = ∂z/∂x, q = ∂z/∂y.
"""

import numpy as np

from fastac.scenes.sensor_schema import Sensor


def pixel_centres_mm(sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """x and y of each pixel's centre in mm, float64, (H, W) each."""
    u = np.arange(sensor.width_px) - (sensor.width_px - 1) / 2
    v = np.arange(sensor.height_px) - (sensor.height_px - 1) / 2
    x, y = np.meshgrid(u * sensor.pitch_mm, v * sensor.pitch_mm)
    return x, y


def rest_depth_mm(sensor: Sensor) -> np.ndarray:
    """z of the undeformed skin in mm, float64 (H, W): an ellipsoid's cap, zero at the corner pixels.

    z = c √(1 − (x/a)² − (y/b)²), less its value at the corner. A flat skin is zero everywhere.
    """
    x, y = pixel_centres_mm(sensor)
    if sensor.geometry == "flat":
        return np.zeros_like(x)
    a, b, c = sensor.ellipsoid.semi_axes_mm
    z = c * np.sqrt(1 - (x / a) ** 2 - (y / b) ** 2)
    return z - z[0, 0]


def rest_slopes(sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """p and q of the undeformed skin, float64 (H, W) each, from the ellipsoid's equation."""
    x, y = pixel_centres_mm(sensor)
    if sensor.geometry == "flat":
        return np.zeros_like(x), np.zeros_like(x)
    a, b, c = sensor.ellipsoid.semi_axes_mm
    root = np.sqrt(1 - (x / a) ** 2 - (y / b) ** 2)
    return -c * x / (a * a * root), -c * y / (b * b * root)


def rest_depth_at_mm(sensor: Sensor, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """z of the undeformed skin in mm at any x, y (…), float64; at the pixels equal to `rest_depth_mm`."""
    if sensor.geometry == "flat":
        return np.zeros(np.broadcast(x_mm, y_mm).shape)
    a, b, c = sensor.ellipsoid.semi_axes_mm
    corner_x, corner_y = ((n - 1) * sensor.pitch_mm / 2 for n in (sensor.width_px, sensor.height_px))
    lowest = np.sqrt(1 - (corner_x / a) ** 2 - (corner_y / b) ** 2)
    return c * (np.sqrt(np.maximum(1 - (x_mm / a) ** 2 - (y_mm / b) ** 2, 0)) - lowest)


def ball_slopes(x_mm: np.ndarray, y_mm: np.ndarray, ball_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """p and q of a skin that lies against a ball of diameter `ball_mm`.

    `x_mm` and `y_mm` are measured from the ball's axis and must lie under the ball. The skin follows the
    ball's lower side, z = z_centre − √(R² − x² − y²), so it rises away from the axis: p = x / √(R² − r²).
    """
    root = np.sqrt((ball_mm / 2) ** 2 - x_mm**2 - y_mm**2)
    return x_mm / root, y_mm / root


def normals_from_slopes(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Outward unit normals (…, 3) = (−p, −q, 1) / norm, in the slopes' precision."""
    length = np.sqrt(p * p + q * q + 1)
    return np.stack([-p / length, -q / length, 1 / length], axis=-1)


def deformed_slopes(displacement_mm: np.ndarray, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """p and q, (H, W) each, of the skin after a displacement (H, W) along −z, in mm.

    The undeformed skin's slopes are in closed form; the displacement's derivatives come from a cubic spline.
    """
    from scipy.interpolate import RectBivariateSpline  # loads slowly, and all else here needs none of it

    rows = np.arange(sensor.height_px) * sensor.pitch_mm
    columns = np.arange(sensor.width_px) * sensor.pitch_mm
    spline = RectBivariateSpline(rows, columns, displacement_mm)
    p, q = rest_slopes(sensor)
    p -= spline(rows, columns, dy=1)
    q -= spline(rows, columns, dx=1)
    return p, q
