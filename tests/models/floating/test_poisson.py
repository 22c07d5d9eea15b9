"""The float solver against a direct solution of the sparse linear system."""

import numpy as np
import pytest
from scipy.sparse import diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve

from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer.laplacian import boundary_term


def laplacian(n: int):
    """The 5-point Laplacian on n×n inner pixels with a zero boundary, sparse."""
    one = diags_array([np.ones(n - 1), np.full(n, -2.0), np.ones(n - 1)], offsets=[-1, 0, 1])
    return (kron(one, eye_array(n)) + kron(eye_array(n), one)).tocsc()


def five_point(z: np.ndarray) -> np.ndarray:
    """The 5-point Laplacian of a surface (H, W) at its inner pixels."""
    return z[:-2, 1:-1] + z[2:, 1:-1] + z[1:-1, :-2] + z[1:-1, 2:] - 4 * z[1:-1, 1:-1]


@pytest.mark.parametrize("n", [1, 5, 14, 30])
def test_solve_equals_a_direct_solver(n):
    source = np.random.default_rng(n).normal(size=(3, n, n))
    found = solve(source)
    assert found.shape == source.shape
    for f, z in zip(source, found, strict=True):
        direct = spsolve(laplacian(n), f.ravel())
        np.testing.assert_allclose(z.ravel(), direct, rtol=1e-10, atol=1e-10 * np.abs(direct).max())


SURFACES = {
    "plane": (lambda x, y: 3 + 0.5 * x - 0.2 * y, lambda x, y: (0.5 + 0 * x, -0.2 + 0 * y)),
    "harmonic": (lambda x, y: x * x - y * y + x * y, lambda x, y: (2 * x + y, x - 2 * y)),
    "quadratic": (lambda x, y: 7 - x * x - 2 * y * y + x * y, lambda x, y: (y - 2 * x, x - 4 * y)),
}


@pytest.mark.parametrize("divergence", ["central", "backward"])
@pytest.mark.parametrize("surface", SURFACES)
def test_quadratic_surfaces_come_back_exactly(surface, divergence):
    """Their slopes are linear, so that both differences are exact; the boundary prior gives the constant
    part."""
    height, slopes = SURFACES[surface]
    y, x = np.indices((16, 16)) / 10 - 0.7
    z = height(x, y) * 10  # in px: one px is 0.1 of the unit of x and y
    source = source_of(np.stack(slopes(x, y), axis=-1), divergence)
    found = solve(source - boundary_term(z))
    np.testing.assert_allclose(found, z[1:-1, 1:-1], atol=1e-11)
    # Without the prior the boundary is at zero, which these surfaces are not.
    assert np.abs(solve(source) - z[1:-1, 1:-1]).max() > 1


def test_any_surface_comes_back_from_its_five_point_laplacian():
    z = np.random.default_rng(2).normal(size=(17, 17))
    np.testing.assert_allclose(solve(five_point(z) - boundary_term(z)), z[1:-1, 1:-1], atol=1e-12)


@pytest.mark.parametrize(("divergence", "order"), [("central", 2), ("backward", 1)])
def test_order_of_convergence(divergence, order):
    """Halving the pixel divides the error by 4 (central) or 2 (backward, the paper's)."""
    errors = []
    for size in (33, 65, 129):
        h = 1 / (size - 1)
        y, x = np.mgrid[0 : 1 : size * 1j, 0 : 1 : size * 1j]
        z = np.sin(2 * x + 0.3) * np.cos(3 * y) + 0.2 * np.exp(x * y)
        p = 2 * np.cos(2 * x + 0.3) * np.cos(3 * y) + 0.2 * y * np.exp(x * y)
        q = -3 * np.sin(2 * x + 0.3) * np.sin(3 * y) + 0.2 * x * np.exp(x * y)
        source = source_of(np.stack([p, q], axis=-1), divergence)
        found = solve(source - boundary_term(z / h)) * h
        errors.append(np.abs(found - z[1:-1, 1:-1]).max())
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(rates, order, atol=0.15)
