"""The discrete Poisson problem against sums written out, a sparse Laplacian, and SciPy's sine transform."""

from math import cos, pi

import numpy as np
import pytest
from scipy.fft import dst
from scipy.sparse import diags_array, eye_array, kron

from fastac.models.integer.laplacian import (
    STENCILS,
    boundary_term,
    divergence_of,
    eigenvalues,
    sine_matrix,
    transposed_differences,
)


def laplacian(n: int):
    """The 5-point Laplacian on n×n inner pixels with a zero boundary, sparse."""
    one = diags_array([np.ones(n - 1), np.full(n, -2.0), np.ones(n - 1)], offsets=[-1, 0, 1])
    return (kron(one, eye_array(n)) + kron(eye_array(n), one)).tocsc()


@pytest.mark.parametrize("n", [1, 5, 14, 126])
def test_sine_matrix_is_orthonormal_and_its_own_inverse(n):
    s = sine_matrix(n)
    np.testing.assert_array_equal(s, s.T)
    np.testing.assert_allclose(s @ s, np.eye(n), atol=1e-12)
    np.testing.assert_allclose(s, dst(np.eye(n), type=1, norm="ortho"), atol=1e-12)


@pytest.mark.parametrize("n", [1, 4, 14])
def test_eigenvalues_are_the_laplacian_s(n):
    found = eigenvalues(n)
    assert found[0, 0] == pytest.approx(4 * cos(pi / (n + 1)) - 4)
    assert (found > -8).all()
    assert (found < 0).all()
    np.testing.assert_allclose(
        np.sort(found, axis=None), np.linalg.eigvalsh(laplacian(n).toarray()), atol=1e-12
    )
    # Each belongs to its own sine mode.
    s = sine_matrix(n)
    for m, k in np.ndindex(n, n):
        mode = np.outer(s[m], s[k]).ravel()
        np.testing.assert_allclose(laplacian(n) @ mode, found[m, k] * mode, atol=1e-12)


def test_boundary_term_sums_the_neighbours_on_the_boundary():
    rest = np.random.default_rng(1).normal(size=(6, 7))
    expected = np.zeros((4, 5))
    for i in range(1, 5):
        for j in range(1, 6):
            for v, u in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                if v in (0, 5) or u in (0, 6):
                    expected[i - 1, j - 1] += rest[v, u]
    np.testing.assert_allclose(boundary_term(rest), expected, atol=1e-15)


@pytest.mark.parametrize("divergence", STENCILS)
def test_divergence_is_the_sum_of_both_slopes_differences(divergence):
    slopes = np.random.default_rng(2).integers(-99, 100, (6, 7, 2))
    ahead = {"central": 1, "backward": 0}[divergence]
    expected = np.zeros((4, 5), int)
    for i in range(4):
        for j in range(5):
            v, u = i + 1, j + 1
            expected[i, j] = slopes[v, u + ahead, 0] - slopes[v, u - 1, 0]
            expected[i, j] += slopes[v + ahead, u, 1] - slopes[v - 1, u, 1]
    np.testing.assert_array_equal(divergence_of(slopes, divergence), expected)


@pytest.mark.parametrize("divergence", STENCILS)
def test_transposed_differences_are_the_transpose(divergence):
    """⟨w, D g⟩ = ⟨Dᵀ w, g⟩ for any weights w and slopes g, in integers."""
    rng = np.random.default_rng(3)
    weights, slopes = rng.integers(-9, 10, (5, 5)), rng.integers(-99, 100, (7, 7, 2))
    ahead = (weights * divergence_of(slopes, divergence)).sum()
    assert (transposed_differences(weights, divergence) * slopes).sum() == ahead


@pytest.mark.parametrize(
    ("divergence", "span", "fraction_bits", "norm", "kernel"),
    [("central", 2, 1, 1.0, [0.5, 0, -0.5]), ("backward", 1, 0, 2.0, [1, -1])],
)
def test_stencils(divergence, span, fraction_bits, norm, kernel):
    stencil = STENCILS[divergence]
    assert (stencil.span, stencil.fraction_bits, stencil.norm) == (span, fraction_bits, norm)
    np.testing.assert_array_equal(stencil.kernel, kernel)
    assert stencil.scale == 1 / span
