import numpy as np
import pytest
from scipy.integrate import quad

from fastac.scenes.sensor_schema import Elastomer, Sensor
from fastac.sensor.geometry import pixel_centres_mm, rest_depth_mm
from fastac.sensor.mechanics.layer import Layer, layer_compliance, modulation
from fastac.sensor.mechanics.press import ContactError

CURVED = Sensor(geometry="fingertip", height_px=64, width_px=64, pitch_mm=0.25)


def test_thin_and_deep_limits_of_the_layer():
    layer = Elastomer(modulus_mpa=0.5, poisson_ratio=0.4, thickness_mm=2.0)
    confined = 0.5 * (1 - 0.4) / ((1 + 0.4) * (1 - 2 * 0.4))
    thin, nearly, deep = layer_compliance(np.array([0.0, 1e-4, 300.0]), layer)
    assert thin == pytest.approx(2.0 / confined)
    assert nearly == pytest.approx(thin, rel=1e-6)
    assert deep == pytest.approx(2 * (1 - 0.4**2) / (0.5 * 300))


def test_layer_satisfies_the_equations_of_elasticity():
    """Plane strain, by collocation: surface pressure cos kx, no shear, fixed base."""
    k, nu, e, h = 0.7, 0.45, 0.3, 2.0
    g = e / (2 * (1 + nu))
    # Papkovich-Neuber in a layer: u_x = sin kx · a(z), u_z = cos kx · b(z), with (a, b) from four solutions.
    kappa = 3 - 4 * nu

    def solutions(z):
        up, down = np.exp(k * z), np.exp(-k * z)
        a = np.array([up, down, z * up, z * down])
        b = np.array([-up, down, (kappa / k - z) * up, (kappa / k + z) * down])
        return a, b

    step = 1e-6
    a0, b0 = solutions(0.0)
    ah, bh = solutions(h)
    da, db = ((hi - lo) / (2 * step) for hi, lo in zip(solutions(h + step), solutions(h - step), strict=True))
    # Equilibrium of the four solutions, mid-layer: μ∇²u + (λ+μ)∇(∇·u) = 0 divided by μ.
    s = 1e-4
    (am, bm), (al, bl), (ar, br) = solutions(1.0), solutions(1.0 - s), solutions(1.0 + s)
    ratio = 1 / (1 - 2 * nu)
    a1, b1 = (ar - al) / (2 * s), (br - bl) / (2 * s)
    a2, b2 = (ar - 2 * am + al) / s**2, (br - 2 * bm + bl) / s**2
    np.testing.assert_allclose(a2 - k * k * am - ratio * k * (k * am + b1), 0, atol=1e-5)
    np.testing.assert_allclose(b2 - k * k * bm + ratio * (k * a1 + b2), 0, atol=1e-5)

    lame = 2 * g * nu / (1 - 2 * nu)
    conditions = np.array([a0, b0, g * (da - k * bh), lame * (k * ah + db) + 2 * g * db])
    weights = np.linalg.solve(conditions, [0, 0, 0, -1.0])
    want = layer_compliance(np.array([k]), Elastomer(modulus_mpa=e, poisson_ratio=nu, thickness_mm=h))[0]
    assert -(weights @ bh) == pytest.approx(want, rel=1e-6)


def test_modulation_is_smooth_positive_and_zero_at_the_rim():
    c = modulation(CURVED)
    for edge in (c[0], c[-1], c[:, 0], c[:, -1]):
        np.testing.assert_array_equal(edge, 0)
    assert c[1:-1, 1:-1].min() > 0
    inside = c[8:-8, 8:-8]
    assert np.all(np.diff(inside, axis=0) > 0), "softer towards one end"
    assert np.abs(np.diff(c, axis=0)).max() < 0.4


def test_operator_is_symmetric_and_positive():
    layer = Layer(CURVED)
    rng = np.random.default_rng(2)
    a, b = rng.random((2, 64, 64))
    assert np.sum(a * layer.displacement_mm(b)) == pytest.approx(np.sum(b * layer.displacement_mm(a)))
    assert np.sum(a * layer.displacement_mm(a)) > 0


def test_no_wrap_around():
    """A point load near one edge displaces a small image as it does an image four times as wide."""
    uniform = Elastomer(thickness_variation=0)
    results = []
    for size in (64, 256):
        sensor = Sensor(geometry="flat", height_px=size, width_px=size, pitch_mm=0.25, elastomer=uniform)
        pressure = np.zeros((size, size))
        middle = size // 2
        pressure[middle, middle - 24] = 1.0
        displacement = Layer(sensor).displacement_mm(pressure)
        results.append(displacement[middle - 25 : middle + 25, middle - 25 : middle + 25])
    small, large = results
    assert np.abs(small - large).max() < 1e-4 * large.max()


def test_hertz():
    """A thick, uniform layer: contact radius a³ = 3FR/4E*, approach a²/R less the correction for the base."""
    ball_mm, load, e, nu, h = 8.0, 0.05, 0.2, 0.3, 12.0
    elastomer = Elastomer(modulus_mpa=e, poisson_ratio=nu, thickness_mm=h, thickness_variation=0, rim_mm=0.1)
    sensor = Sensor(geometry="flat", height_px=96, width_px=96, pitch_mm=0.05, elastomer=elastomer)
    contact = Layer(sensor).press(0.0, 0.0, ball_mm=ball_mm, load_n=load)
    stiffness = e / (1 - nu**2)
    radius = (3 * load * ball_mm / 2 / (4 * stiffness)) ** (1 / 3)
    assert contact.contact_radius_mm == pytest.approx(radius, rel=0.03)

    def lost(x):
        return 1 - layer_compliance(np.array([x / h]), elastomer)[0] * stiffness * x / h / 2

    base = load / (np.pi * stiffness * h) * quad(lost, 1e-9, 60)[0]
    assert contact.approach_mm == pytest.approx(radius**2 / (ball_mm / 2) - base, rel=0.03)
    x, y = pixel_centres_mm(sensor)
    peak = 3 * load / (2 * np.pi * radius**2)
    hertz = peak * np.sqrt(np.maximum(1 - (x * x + y * y) / radius**2, 0))
    assert np.abs(contact.pressure_mpa - hertz).mean() < 0.05 * hertz.mean()


@pytest.mark.parametrize(("x", "y", "load"), [(0.0, 0.0, 0.5), (4.9, -4.9, 1.5), (-3.3, 4.9, 1.0)])
def test_contact_is_an_equilibrium_without_overlap(x, y, load):
    contact = Layer(CURVED).press(x, y, ball_mm=5.0, load_n=load)
    in_contact = contact.pressure_mpa > 0
    assert contact.pressure_mpa.min() == 0
    assert contact.pressure_mpa.sum() * CURVED.pitch_mm**2 == pytest.approx(load, rel=1e-12)
    assert contact.gap_mm.min() > -2e-6 * contact.approach_mm
    assert np.abs(contact.gap_mm[in_contact]).max() < 2e-6 * contact.approach_mm
    np.testing.assert_array_equal(
        contact.displacement_mm, Layer(CURVED).displacement_mm(contact.pressure_mpa)
    )
    for edge in (0, -1):
        np.testing.assert_array_equal(contact.displacement_mm[edge], 0)
        np.testing.assert_array_equal(contact.displacement_mm[:, edge], 0)
    assert contact.displacement_mm[in_contact].min() > 0
    assert contact.displacement_mm.min() < 0, "a nearly incompressible gel bulges beside the ball"


def test_pressed_skin_is_the_ball():
    contact = Layer(CURVED).press(1.0, 2.0, ball_mm=5.0, load_n=1.0)
    in_contact = contact.pressure_mpa > 0
    x, y = pixel_centres_mm(CURVED)
    skin = rest_depth_mm(CURVED) - contact.displacement_mm
    ball = -np.sqrt(6.25 - (x[in_contact] - 1) ** 2 - (y[in_contact] - 2) ** 2)
    assert np.ptp(skin[in_contact] - ball) < 1e-5


def test_more_load_sinks_deeper_and_the_soft_end_deepest():
    layer = Layer(CURVED)
    loads = [layer.press(0.0, 0.0, ball_mm=5.0, load_n=f).approach_mm for f in (0.5, 1.0, 1.5)]
    assert 0.3 < loads[0] < loads[1] < loads[2] < 1.0
    stiff, soft = (layer.press(0.0, y, ball_mm=5.0, load_n=1.0).approach_mm for y in (-4.0, 4.0))
    assert soft > 1.1 * stiff


@pytest.mark.parametrize(
    ("x", "ball", "load", "message"),
    [
        (30.0, 5.0, 1.0, "expected inside the image"),
        (7.8, 5.0, 20.0, "fixed rim"),
        (0.0, 1.2, 5.0, "equator|sinks"),
        (0.0, 12.0, 100.0, "sinks|rim"),
    ],
)
def test_refuses_what_the_model_cannot_represent(x, ball, load, message):
    with pytest.raises(ContactError, match=message):
        Layer(CURVED).press(x, 0.0, ball_mm=ball, load_n=load)
