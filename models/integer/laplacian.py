"""The discrete Poisson problem on the image: divergence of the slopes, Laplacian, its sine modes."""

import numpy as np


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


def boundary_term(rest: np.ndarray) -> np.ndarray:
    """Σ of the prior over each inner pixel's neighbours on the boundary; `rest` (H, W) to (H − 2, W − 2)."""
    term = np.zeros((rest.shape[0] - 2, rest.shape[1] - 2))
    term[0] += rest[0, 1:-1]
    term[-1] += rest[-1, 1:-1]
    term[:, 0] += rest[1:-1, 0]
    term[:, -1] += rest[1:-1, -1]
    return term


def divergence_of(slopes: np.ndarray, divergence: str) -> np.ndarray:
    """Slopes (..., H, W, 2) to their divergence (..., H − 2, W − 2); see PoissonSource for its units."""
    p, q = slopes[..., 0], slopes[..., 1]
    if divergence == "central":
        return (p[..., 1:-1, 2:] - p[..., 1:-1, :-2]) + (q[..., 2:, 1:-1] - q[..., :-2, 1:-1])
    return (p[..., 1:-1, 1:-1] - p[..., 1:-1, :-2]) + (q[..., 1:-1, 1:-1] - q[..., :-2, 1:-1])
