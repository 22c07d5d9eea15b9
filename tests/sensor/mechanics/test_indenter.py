import numpy as np
import pytest

from fastac.sensor.geometry import ball_slopes
from fastac.sensor.mechanics.indenter import Ball, Cylinder, Edge, FlatPunch, HeightMap
from fastac.sensor.mechanics.press import FemError

V, U = np.mgrid[:33, :33]
BUMPS = HeightMap(0.2 * np.sin(U / 5.0) * np.cos(V / 7.0), 0.15)
ALL = [Ball(5.0), Cylinder(3.0, 4.0, 30.0), Edge(4.0, 80.0, 0.3, 60.0), FlatPunch(3.0), BUMPS]


@pytest.mark.parametrize("indenter", ALL, ids=lambda i: type(i).__name__)
def test_slopes_are_the_derivatives_of_the_surface(indenter):
    x, y = np.random.default_rng(0).uniform(-0.9, 0.9, (2, 50))
    step = 1e-5
    z, p, q = indenter.surface(x, y)
    assert z.min() >= 0
    np.testing.assert_allclose(
        p, (indenter.surface(x + step, y)[0] - indenter.surface(x - step, y)[0]) / 2 / step, atol=1e-6
    )
    np.testing.assert_allclose(
        q, (indenter.surface(x, y + step)[0] - indenter.surface(x, y - step)[0]) / 2 / step, atol=1e-6
    )


def test_ball_is_that_of_the_geometry():
    x, y = np.array([0.0, 1.0]), np.array([0.5, -1.5])
    _, p, q = Ball(5.0).surface(x, y)
    np.testing.assert_allclose((p, q), ball_slopes(x, y, 5.0))


def test_outlines():
    def inside(indenter, x, y):
        return bool(np.isfinite(indenter.surface(np.array([x]), np.array([y]))[0][0]))

    assert inside(Ball(2.0), 0.9, 0.0)
    assert not inside(Ball(2.0), 0.9, 0.9)
    lying = Cylinder(2.0, 6.0, 90.0)
    assert inside(lying, 0.0, 2.9)
    assert not inside(lying, 2.9, 0.0)
    assert inside(Edge(4.0, angle_deg=45.0), 1.4, 1.4)
    assert not inside(Edge(4.0, angle_deg=45.0), 1.5, 1.5)
    assert not inside(FlatPunch(2.0), 0.8, 0.8)
    assert not inside(BUMPS, 2.5, 0.0)


def test_edge_becomes_its_opening_and_rounds_its_tip():
    y = np.array([0.0, 3.0, 3.1])
    z, _, q = Edge(4.0, opening_deg=60.0, rounding_mm=0.1).surface(np.zeros(3), y)
    assert z[0] == q[0] == 0
    assert (z[2] - z[1]) / 0.1 == pytest.approx(np.tan(np.deg2rad(60)), rel=1e-3)


def test_height_map_passes_through_its_samples():
    z, _, _ = BUMPS.surface(np.array([0.15 * 4]), np.array([-0.15 * 6]))
    expected = BUMPS.height_mm[16 - 6, 16 + 4] - BUMPS.height_mm.min()
    assert z[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("indenter", "message"),
    [
        (lambda: Ball(0.0), "ball_mm = 0: expected more than 0"),
        (lambda: Cylinder(2.0, -1.0), "length_mm = -1"),
        (lambda: Edge(2.0, opening_deg=180.0), "opening_deg = 180"),
        (lambda: FlatPunch(np.nan), "diameter_mm = nan"),
        (lambda: HeightMap(np.zeros((3, 8)), 0.1), r"\(3, 8\): expected two axes of at least 4"),
        (lambda: HeightMap(np.full((8, 8), np.inf), 0.1), "finite"),
    ],
)
def test_refuses_impossible_shapes(indenter, message):
    with pytest.raises(FemError, match=message):
        indenter().surface(np.zeros(1), np.zeros(1))
