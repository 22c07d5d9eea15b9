"""The undeformed skin from the sensor's CAD: the scene's own surface, a height map, or an STL file.

x and y are in mm from the image's centre. z is in mm, positive away from the camera and zero at the lowest
corner of the image, as in a dataset; a constant added to a file's heights has no effect.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import normals_from_slopes, pixel_centres_mm, rest_depth_at_mm, rest_slopes
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.mechanics.indenter import Ball
from fastac.store.files import DamagedFileError, load_array

SEARCH_POINTS_PER_PIXEL = 8
"""Points along each side of a pixel at which the first touch is searched."""


@dataclass(frozen=True)
class Cad:
    """The surface of the undeformed skin above a sensor's image."""

    sensor: Sensor
    depth_at_mm: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """z at x and y, arrays of one shape with values inside the image."""
    slopes: tuple[np.ndarray, np.ndarray]
    """p and q at the pixels, (H, W) each."""

    @cached_property
    def rest_depth_mm(self) -> np.ndarray:
        """(H, W) z at the pixels."""
        return self.depth_at_mm(*pixel_centres_mm(self.sensor))

    def normals(self) -> np.ndarray:
        """(H, W, 3) outward unit normals at the pixels."""
        return normals_from_slopes(*self.slopes)

    def first_touch_mm(self, ball_mm: float, x_mm: float, y_mm: float) -> float:
        """z of a ball's lowest point when, moving down at (x_mm, y_mm), it first touches the skin.

        Searched at every pixel below the ball, then on a finer grid around the pixel that touches first.
        """
        half, at, reach, step = (
            half_extent_mm(self.sensor),
            np.array([x_mm, y_mm]),
            ball_mm / 2,
            self.sensor.pitch_mm,
        )
        for _ in range(2):
            low, high = np.maximum(at - reach, -half), np.minimum(at + reach, half)
            counts = np.maximum(((high - low) / step).astype(int), 1) + 1
            x, y = np.meshgrid(*map(np.linspace, low, high, counts))
            touch = self.depth_at_mm(x, y) - Ball(ball_mm).surface(x - x_mm, y - y_mm)[0]
            first = np.unravel_index(touch.argmax(), touch.shape)
            at, reach, step = np.array([x[first], y[first]]), 2 * step, step / SEARCH_POINTS_PER_PIXEL
        return float(touch.max())


def half_extent_mm(sensor: Sensor) -> np.ndarray:
    """x and y of the last pixel's centre, (2,) in mm: half the image's extent."""
    return np.array([sensor.width_px - 1, sensor.height_px - 1]) * sensor.pitch_mm / 2


def of_scene(sensor: Sensor) -> Cad:
    """The surface described by the scene's sensor: flat or an ellipsoid."""
    return Cad(sensor, lambda x, y: rest_depth_at_mm(sensor, x, y), rest_slopes(sensor))


def of_file(sensor: Sensor, path: Path, pitch_mm: float | None = None) -> Cad:
    """The surface in an STL file, in mm with its origin on the image's axis, or in a height map, `.npy`.

    A height map holds z in mm, (rows, columns) with rows along y, sampled every `pitch_mm` and centred on the
    image's axis. Raises ImportFailure on a file that cannot be read or does not cover the image.
    """
    if path.suffix.lower() == ".stl":
        if pitch_mm is not None:
            raise ImportFailure(f"{path}: pitch_mm = {pitch_mm:g}: an STL file has its own scale, in mm")
        return _of_samples(sensor, path, *_stl_heights(sensor, path))
    if path.suffix.lower() != ".npy":
        raise ImportFailure(f"{path}: expected an STL file or a height map, .npy")
    if pitch_mm is None or not (np.isfinite(pitch_mm) and pitch_mm > 0):
        raise ImportFailure(f"{path}: pitch_mm = {pitch_mm}: a height map needs the distance of its samples")
    height = read_array(path)
    if height.ndim != 2 or min(height.shape) < 4 or height.dtype.kind not in "fiu":
        raise ImportFailure(f"{path}: {height.dtype} {height.shape}: expected numbers (rows, columns)")
    y, x = ((np.arange(n) - (n - 1) / 2) * pitch_mm for n in height.shape)
    return _of_samples(sensor, path, x, y, height.astype(float))


def read_array(path: Path) -> np.ndarray:
    """The array in an `.npy` file, without unpickling. Raises ImportFailure where it cannot be read."""
    try:
        return load_array(path)
    except FileNotFoundError:
        raise ImportFailure(f"{path}: no such file") from None
    except DamagedFileError as error:
        raise ImportFailure(str(error)) from None
    except OSError as error:
        raise ImportFailure(f"{path}: {error.strerror or error}") from None


def _of_samples(sensor: Sensor, path: Path, x: np.ndarray, y: np.ndarray, height: np.ndarray) -> Cad:
    """A cubic spline through heights (rows, columns) at x (columns,) and y (rows,), shifted to zero at the
    lowest corner of the image."""
    half = half_extent_mm(sensor)
    for key, axis, need in (("x", x, half[0]), ("y", y, half[1])):
        if axis[-1] < need - 1e-9:
            raise ImportFailure(f"{path}: {key} = ±{axis[-1]:g} mm: the image needs ±{need:g} mm")
    rows, columns = (
        slice(*np.searchsorted(a, (-n - 1.5 * (a[1] - a[0]), n + 1.5 * (a[1] - a[0]))))
        for a, n in ((y, half[1]), (x, half[0]))
    )
    inside = height[rows, columns]
    if not np.isfinite(inside).all():
        raise ImportFailure(f"{path}: height: expected a surface above the whole image, with no holes")
    spline = RectBivariateSpline(y[rows], x[columns], inside)
    corners = spline.ev(*np.meshgrid((-half[1], half[1]), (-half[0], half[0])))
    pixel_x, pixel_y = pixel_centres_mm(sensor)
    slopes = spline.ev(pixel_y, pixel_x, dy=1), spline.ev(pixel_y, pixel_x, dx=1)
    return Cad(sensor, lambda x, y: spline.ev(y, x) - corners.min(), slopes)


def _stl_heights(sensor: Sensor, path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The upper surface of a mesh on a grid with the image's pitch and a margin of two pixels.

    Returns x, y and heights (rows, columns), NaN where the mesh has no point.
    """
    import trimesh  # slow to load, and needed for STL files only

    try:
        with path.open("rb") as file:
            corners = np.asarray(trimesh.load_mesh(file, file_type="stl").triangles)
    except FileNotFoundError:
        raise ImportFailure(f"{path}: no such file") from None
    except Exception as error:  # trimesh raises whatever its readers meet
        raise ImportFailure(f"{path}: not a readable STL file: {error!r}") from None
    if not len(corners) or not np.isfinite(corners).all():
        raise ImportFailure(f"{path}: not a readable STL file: no triangles, or corners that are not finite")
    half = half_extent_mm(sensor)
    x, y = (
        np.arange(-2, n + 2) * sensor.pitch_mm - side
        for n, side in ((sensor.width_px, half[0]), (sensor.height_px, half[1]))
    )
    height = np.full((len(y), len(x)), -np.inf)
    for a, b, c in corners:
        _raise_to(height, x, y, a, b, c)
    height[np.isinf(height)] = np.nan
    return x, y, height


def _raise_to(height: np.ndarray, x: np.ndarray, y: np.ndarray, a, b, c) -> None:
    """Raise the grid's heights to those of the triangle a, b, c where it lies above them, in place."""
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    columns = slice(*np.searchsorted(x, (low[0] - 1e-9, high[0] + 1e-9)))
    rows = slice(*np.searchsorted(y, (low[1] - 1e-9, high[1] + 1e-9)))
    (ux, uy), (vx, vy) = b[:2] - a[:2], c[:2] - a[:2]
    area = ux * vy - uy * vx
    if area == 0 or columns.start == columns.stop or rows.start == rows.stop:
        return
    dx, dy = x[columns] - a[0], (y[rows] - a[1])[:, None]
    s, t = (dx * vy - dy * vx) / area, (ux * dy - uy * dx) / area
    inside = (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1 + 1e-9)
    z = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
    part = height[rows, columns]
    np.maximum(part, np.where(inside, z, -np.inf), out=part)
