"""Depth from slopes in floating point: the Poisson equation on a Dirichlet boundary, by DST-I.

Lengths are in pixels here (a slope times one pixel is one pixel of depth); multiply by the pitch for mm.
Source: Lu et al., "FasTac", boundary-prior fast Poisson reconstruction; Press et al., "Numerical Recipes",
3rd ed., section 20.4.1 (Fourier methods for boundary value problems).
"""

import numpy as np
from scipy.fft import dstn

from fastac.models.integer import divergence_of


def sine_matrix(size: int) -> np.ndarray:
    """The orthonormal DST-I, sqrt(2/(N+1)) sin(π(k+1)(n+1)/(N+1)): symmetric and its own inverse, (N, N)."""
    index = np.arange(1, size + 1)
    return np.sqrt(2 / (size + 1)) * np.sin(np.pi * np.outer(index, index) / (size + 1))


def row_eigenvalues(size: int) -> np.ndarray:
    """Those of the second difference along N inner points, (N,), in (−4, 0)."""
    return 2 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1)) - 2


def eigenvalues(size: int) -> np.ndarray:
    """Those of the 5-point Laplacian on N×N inner points, (N, N), in (−8, 0)."""
    one = row_eigenvalues(size)
    return one[:, None] + one[None, :]


def divergence_scale(divergence: str) -> float:
    """px per px² of one unit of `integer.divergence_of`."""
    return 0.5 if divergence == "central" else 1.0


def source_of(slopes: np.ndarray, divergence: str) -> np.ndarray:
    """Slopes (..., H, W, 2) to the source (..., H − 2, W − 2) of the 5-point Laplacian, px per px²."""
    return divergence_of(slopes, divergence) * divergence_scale(divergence)


def boundary_term(rest: np.ndarray) -> np.ndarray:
    """Σ of the prior over each inner pixel's neighbours on the boundary; `rest` (H, W) to (H − 2, W − 2)."""
    term = np.zeros((rest.shape[0] - 2, rest.shape[1] - 2))
    term[0] += rest[0, 1:-1]
    term[-1] += rest[-1, 1:-1]
    term[:, 0] += rest[1:-1, 0]
    term[:, -1] += rest[1:-1, -1]
    return term


def solve(source: np.ndarray) -> np.ndarray:
    """Sources (..., N, N) to solutions with a zero boundary."""
    transformed = dstn(source, type=1, norm="ortho", axes=(-2, -1))
    return dstn(transformed / eigenvalues(source.shape[-1]), type=1, norm="ortho", axes=(-2, -1))
