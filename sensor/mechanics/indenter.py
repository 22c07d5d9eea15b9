"""Rigid indenters: the lower surface z(x, y) of each, and its slopes.

x and y are in mm from the indenter's axis, z from its lowest point up. Outside its outline a surface is
infinite. Slopes are p = ∂z/∂x and q = ∂z/∂y.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import RectBivariateSpline

from fastac.sensor.mechanics.press import FemError

Surface = tuple[np.ndarray, np.ndarray, np.ndarray]
"""z in mm, p and q, arrays of one shape; outside the outline z is infinite and the slopes are zero."""


def _positive(**lengths: float) -> None:
    for key, value in lengths.items():
        if not (np.isfinite(value) and value > 0):
            raise FemError(f"{key} = {value:g}: expected more than 0")


def _outlined(inside: np.ndarray, z: np.ndarray, p: np.ndarray, q: np.ndarray) -> Surface:
    return np.where(inside, z, np.inf), np.where(inside, p, 0.0), np.where(inside, q, 0.0)


def _along(x: np.ndarray, y: np.ndarray, angle_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates along an axis and across it, and the direction across, (2,)."""
    angle = np.deg2rad(angle_deg)
    across = np.array([-np.sin(angle), np.cos(angle)])
    return np.cos(angle) * x + np.sin(angle) * y, across[0] * x + across[1] * y, across


class Indenter(Protocol):
    """What every indenter is: anything that tells its lower surface."""

    def surface(self, x: np.ndarray, y: np.ndarray) -> Surface:
        """z, p and q at points x, y of one shape, in mm from the axis; FemError for impossible lengths."""


@dataclass(frozen=True)
class Ball:
    """A sphere."""

    ball_mm: float
    """Diameter."""

    def surface(self, x: np.ndarray, y: np.ndarray) -> Surface:
        _positive(ball_mm=self.ball_mm)
        radius = self.ball_mm / 2
        under = radius**2 - x**2 - y**2
        root = np.sqrt(np.where(under > 0, under, 1.0))
        return _outlined(under > 0, radius - root, x / root, y / root)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder whose axis is parallel to the image, `angle_deg` from x towards y."""

    diameter_mm: float
    length_mm: float
    angle_deg: float = 0.0

    def surface(self, x: np.ndarray, y: np.ndarray) -> Surface:
        _positive(diameter_mm=self.diameter_mm, length_mm=self.length_mm)
        along, across, direction = _along(x, y, self.angle_deg)
        radius = self.diameter_mm / 2
        under = radius**2 - across**2
        root = np.sqrt(np.where(under > 0, under, 1.0))
        inside = (under > 0) & (np.abs(along) <= self.length_mm / 2)
        slope = across / root
        return _outlined(inside, radius - root, slope * direction[0], slope * direction[1])


@dataclass(frozen=True)
class Edge:
    """A straight wedge pointing down, its edge rounded and `angle_deg` from x towards y.

    z = (√(s² + r²) − r) / tan(opening/2), a hyperbola, with s the distance from the edge and r its rounding.
    """

    length_mm: float
    opening_deg: float = 90.0
    rounding_mm: float = 0.2
    angle_deg: float = 0.0

    def surface(self, x: np.ndarray, y: np.ndarray) -> Surface:
        _positive(length_mm=self.length_mm, rounding_mm=self.rounding_mm, opening_deg=self.opening_deg)
        if self.opening_deg >= 180:
            raise FemError(f"opening_deg = {self.opening_deg:g}: expected less than 180")
        along, across, direction = _along(x, y, self.angle_deg)
        steep = 1 / np.tan(np.deg2rad(self.opening_deg) / 2)
        root = np.hypot(across, self.rounding_mm)
        slope = steep * across / root
        inside = np.abs(along) <= self.length_mm / 2
        return _outlined(
            inside, steep * (root - self.rounding_mm), slope * direction[0], slope * direction[1]
        )


@dataclass(frozen=True)
class FlatPunch:
    """A round punch whose face is parallel to the image."""

    diameter_mm: float

    def surface(self, x: np.ndarray, y: np.ndarray) -> Surface:
        _positive(diameter_mm=self.diameter_mm)
        level = np.zeros(np.broadcast(x, y).shape)
        return _outlined(np.hypot(x, y) <= self.diameter_mm / 2, level, level, level)


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Any surface, sampled on a square grid centred on the axis and interpolated by a bicubic spline."""

    height_mm: np.ndarray
    """(rows, columns) of the lower surface, rows along y; a constant added to it has no effect."""
    pitch_mm: float

    def __post_init__(self):
        _positive(pitch_mm=self.pitch_mm)
        if self.height_mm.ndim != 2 or min(self.height_mm.shape) < 4:
            raise FemError(f"height map: {self.height_mm.shape}: expected two axes of at least 4")
        if not np.isfinite(self.height_mm).all():
            raise FemError("height map: expected finite heights")

    def surface(self, x: np.ndarray, y: np.ndarray) -> Surface:
        rows, columns = ((np.arange(n) - (n - 1) / 2) * self.pitch_mm for n in self.height_mm.shape)
        spline = RectBivariateSpline(rows, columns, self.height_mm - self.height_mm.min())
        inside = (np.abs(x) <= columns[-1]) & (np.abs(y) <= rows[-1])
        return _outlined(inside, spline.ev(y, x), spline.ev(y, x, dy=1), spline.ev(y, x, dx=1))
