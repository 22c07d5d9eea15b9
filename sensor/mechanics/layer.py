"""The soft layer and its contact with a rigid ball: linear elastic, frictionless, unilateral.

The layer's response to pressure p is u = c · (G ∗ (c · p)), u downwards in mm, p in MPa:

- G is the response of a layer of uniform thickness bonded to a rigid base, known in Fourier space (Johnson,
  "Contact Mechanics", 5.8; O'Sullivan and King, J. Tribology 110, 1988, without shear traction).
- c is a smooth positive modulation. c² is the compliance relative to that of the uniform layer: it grows
  along y with the layer's thickness and falls to exactly zero at the rim, where the skin is fixed.

The operator is symmetric and positive, so the contact under a prescribed load has one solution: pressure ≥ 0,
gap ≥ 0, and one of them zero at every pixel. It is computed by the conjugate-gradient method of Polonsky and
Keer, Wear 231 (1999) 206. Load and displacement are vertical: the skin's slope enters through the gap only.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its `fft` is loaded at the first press, for it takes long

from fastac.scenes.sensor_schema import Elastomer, Sensor
from fastac.sensor.geometry import pixel_centres_mm, rest_depth_mm
from fastac.sensor.mechanics.press import ContactError

GAP_TOLERANCE = 1e-6
"""Largest |gap| in contact, relative to the approach: 1 nm at 1 mm. The project's most exact depth solver has
an error of 19 nm, so the ground truth has to be more exact than that."""
MAX_ITERATIONS = 500
RIM_MODULATION = 0.05
"""Modulation c below which a pixel belongs to the fixed rim and cannot be in contact: its compliance, c², is
less than 1/400 of the layer's."""


@dataclass(frozen=True)
class Contact:
    """The equilibrium of a rigid body pressed on the layer."""

    displacement_mm: np.ndarray
    """(H, W) float64: undeformed minus deformed depth; positive in contact, negative where the skin
    bulges."""
    pressure_mpa: np.ndarray
    """(H, W) float64, positive in contact and zero elsewhere; its sum times the pixel's area is the load."""
    gap_mm: np.ndarray
    """(H, W) float64: height of the body's surface above the skin; infinite outside its outline."""
    approach_mm: float
    """How far the body moved along −z from first touch."""
    contact_radius_mm: float
    """Radius of a disc with the contact's area, seen along z."""


def layer_compliance(k: np.ndarray, elastomer: Elastomer) -> np.ndarray:
    """Ratio of surface displacement to pressure of the bonded layer, in mm/MPa, at angular wavenumbers k ≥ 0
    in 1/mm.

    With x = k·h, κ = 3 − 4ν:
    2(1 − ν²)/(E k) · (κ sinh 2x − 2x) / (κ cosh 2x + 2x² + (κ² + 1)/2),
    written with decaying exponentials to avoid overflow. For k → 0 it is h over the confined (oedometric)
    modulus. Source: Johnson, "Contact Mechanics", 5.8.
    """
    nu, e, h = elastomer.poisson_ratio, elastomer.modulus_mpa, elastomer.thickness_mm
    kappa = 3 - 4 * nu
    confined = e * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    uniform = k == 0
    x = np.where(uniform, 1.0, k * h)
    decay = np.exp(-2 * x)
    numerator = kappa * (1 - decay**2) / 2 - 2 * x * decay
    denominator = kappa * (1 + decay**2) / 2 + (2 * x**2 + (kappa**2 + 1) / 2) * decay
    return np.where(uniform, h / confined, 2 * (1 - nu**2) / e * h / x * numerator / denominator)


def modulation(sensor: Sensor) -> np.ndarray:
    """c, float64 (H, W): √(1 ∓ thickness_variation) at the first and last row, and a quintic step to zero at
    the rim."""
    rows = np.arange(sensor.height_px)
    columns = np.arange(sensor.width_px)
    to_edge = np.minimum.outer(np.minimum(rows, rows[::-1]), np.minimum(columns, columns[::-1]))
    t = np.clip(to_edge * sensor.pitch_mm / sensor.elastomer.rim_mm, 0, 1)
    along = np.linspace(-1, 1, sensor.height_px)[:, None]
    return np.sqrt(1 + sensor.elastomer.thickness_variation * along) * t**3 * (10 - 15 * t + 6 * t * t)


class Layer:
    """The elastomer of one sensor, with its Fourier response precomputed; presses on it are independent."""

    def __init__(self, sensor: Sensor):
        self.sensor = sensor
        self.modulation = modulation(sensor)
        self.rest_depth_mm = rest_depth_mm(sensor)
        self.x_mm, self.y_mm = pixel_centres_mm(sensor)
        # Zero padding: twice the image against wrap-around, and room for the response to die out.
        reach = int(np.ceil(6 * sensor.elastomer.thickness_mm / sensor.pitch_mm))
        self._shape = tuple(
            scipy.fft.next_fast_len(n + max(n, reach), real=True) for n in (sensor.height_px, sensor.width_px)
        )
        ky = 2 * np.pi * np.fft.fftfreq(self._shape[0], sensor.pitch_mm)
        kx = 2 * np.pi * np.fft.rfftfreq(self._shape[1], sensor.pitch_mm)
        self._response = layer_compliance(np.hypot(ky[:, None], kx), sensor.elastomer)
        self._kernel = scipy.fft.irfft2(self._response, self._shape)

    def displacement_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """Displacement (H, W) in mm from pressure (H, W) in MPa: u = c · (G ∗ (c · p))."""
        spectrum = scipy.fft.rfft2(self.modulation * pressure_mpa, self._shape)
        full = scipy.fft.irfft2(spectrum * self._response, self._shape)
        return self.modulation * full[: self.sensor.height_px, : self.sensor.width_px]

    def _window_operator(self, rows: slice, columns: slice):
        """The operator of `displacement_mm` restricted to a window of the image: a function from p to u."""
        height, width = rows.stop - rows.start, columns.stop - columns.start
        shape = scipy.fft.next_fast_len(2 * height, real=True), scipy.fft.next_fast_len(2 * width, real=True)
        kernel = np.zeros(shape)
        for to_v, from_v in ((slice(0, height), slice(0, height)), (slice(1 - height, None),) * 2):
            for to_u, from_u in ((slice(0, width), slice(0, width)), (slice(1 - width, None),) * 2):
                kernel[to_v, to_u] = self._kernel[from_v, from_u]
        response = scipy.fft.rfft2(kernel)
        c = self.modulation[rows, columns]
        return lambda p: (
            c * scipy.fft.irfft2(scipy.fft.rfft2(c * p, shape) * response, shape)[:height, :width]
        )

    def press(self, x_mm: float, y_mm: float, *, ball_mm: float, load_n: float) -> Contact:
        """Press a rigid ball of diameter `ball_mm`, its centre above (x_mm, y_mm), along −z with `load_n`.

        Raises ContactError where the contact would reach the fixed rim, the ball's equator or the
        layer's base.
        """
        radius = ball_mm / 2
        under = radius**2 - (self.x_mm - x_mm) ** 2 - (self.y_mm - y_mm) ** 2
        ball = np.where(under > 0, -np.sqrt(np.maximum(under, 0)), np.inf)
        free_gap = ball - self.rest_depth_mm
        if not np.any(under > 0):
            raise ContactError(f"ball at x = {x_mm:g} mm, y = {y_mm:g} mm: expected inside the image")
        where = f"ball of {ball_mm:g} mm at x = {x_mm:g} mm, y = {y_mm:g} mm with {load_n:g} N"
        contact = self._settle(free_gap, load_n, where)
        if under[contact.pressure_mpa > 0].min() < (0.05 * ball_mm) ** 2:
            raise ContactError(f"{where}: the skin reaches the ball's equator")
        return contact

    def press_surface(self, surface_mm: np.ndarray, *, load_n: float, what: str = "surface") -> Contact:
        """Press a rigid body with the lower surface z (H, W), in mm, along −z with `load_n`.

        Outside the body's outline z is infinite; a constant added to z has no effect. `what` names the body
        in errors.

        Raises ContactError where the contact would reach the fixed rim or the layer's base.
        """
        if not np.isfinite(surface_mm).any():
            raise ContactError(f"{what}: expected inside the image")
        return self._settle(surface_mm - self.rest_depth_mm, load_n, f"{what} with {load_n:g} N")

    def _settle(self, free_gap: np.ndarray, load_n: float, where: str) -> Contact:
        """The equilibrium of a body whose surface is `free_gap` (H, W) mm above the undeformed skin.

        `free_gap` is infinite outside the body's outline; `where` begins errors.
        """
        free_gap = free_gap - free_gap.min()
        under = np.isfinite(free_gap)

        # Only pixels under the body can touch it, so the solver works in their bounding box.
        v, u = np.nonzero(under)
        rows, columns = slice(v.min(), v.max() + 1), slice(u.min(), u.max() + 1)
        allowed = under & (self.modulation > RIM_MODULATION)
        pressure = np.zeros_like(free_gap)
        pressure[rows, columns] = self._solve(
            self._window_operator(rows, columns),
            free_gap[rows, columns],
            allowed[rows, columns],
            load_n / self.sensor.pitch_mm**2,
        )
        displacement = self.displacement_mm(pressure)
        in_contact = pressure > 0
        approach = float((free_gap + displacement)[in_contact].mean())
        gap = free_gap + displacement - approach
        self._check(gap, approach, where)
        area = in_contact.sum() * self.sensor.pitch_mm**2
        return Contact(displacement, pressure, gap, approach, float(np.sqrt(area / np.pi)))

    def _check(self, gap: np.ndarray, approach: float, where: str) -> None:
        if gap.min() < -1e-3 * approach:
            raise ContactError(f"{where}: the contact reaches the fixed rim")
        if approach > self.sensor.elastomer.thickness_mm:
            thickness = self.sensor.elastomer.thickness_mm
            raise ContactError(f"{where}: sinks {approach:.2f} mm into {thickness:g} mm of elastomer")

    @staticmethod
    def _solve(apply, free_gap, allowed, total):
        """Pressures ≥ 0 with sum `total` and gaps ≥ 0, by the method of Polonsky and Keer, Wear 231 (1999)
        206.

        apply : from pressures to displacements, both (h, w); allowed : (h, w) bool, pixels that may touch
        """
        if not allowed.any():
            raise ContactError("the ball touches nothing but the fixed rim")
        scale = np.ptp(free_gap[allowed])
        pressure = np.where(allowed & (free_gap < 0.2 * scale), 1.0, 0.0)
        if not pressure.any():
            pressure = allowed.astype(float)
        pressure *= total / pressure.sum()
        direction = np.zeros_like(pressure)
        previous = 1.0
        conjugate = False
        for _ in range(MAX_ITERATIONS):
            in_contact = pressure > 0
            gap = apply(pressure) + np.where(allowed, free_gap, 0.0)
            approach = gap[in_contact].mean()
            gap -= approach
            overlap = allowed & ~in_contact & (gap < 0)
            if np.abs(gap[in_contact | overlap]).max() < GAP_TOLERANCE * approach:
                return pressure
            norm = np.sum(gap[in_contact] ** 2)
            direction = np.where(in_contact, gap + (norm / previous if conjugate else 0) * direction, 0.0)
            previous = norm
            curvature = apply(direction)
            curvature -= curvature[in_contact].mean()
            step = np.sum((gap * direction)[in_contact]) / np.sum((curvature * direction)[in_contact])
            pressure = np.maximum(pressure - step * direction, 0.0)
            overlap = allowed & (pressure == 0) & (gap < 0)
            conjugate = not overlap.any()
            pressure[overlap] -= step * gap[overlap]
            pressure *= total / pressure.sum()
        raise ContactError(f"no equilibrium after {MAX_ITERATIONS} iterations")
