"""Depth from slopes in floating point: the Poisson equation on a Dirichlet boundary, by DST-I.

Lengths are in pixels here (a slope times one pixel is one pixel of depth); multiply by the pitch for mm.
Source: Lu et al., "FasTac", boundary-prior fast Poisson reconstruction; Press et al., "Numerical Recipes",
3rd ed., section 20.4.1 (Fourier methods for boundary value problems).
"""

import numpy as np
from scipy.fft import dstn

from fastac.models.integer.laplacian import STENCILS, divergence_of, eigenvalues


def source_of(slopes: np.ndarray, divergence: str) -> np.ndarray:
    """Slopes (..., H, W, 2) to the source (..., H − 2, W − 2) of the 5-point Laplacian, px per px²."""
    return divergence_of(slopes, divergence) * STENCILS[divergence].scale


def solve(source: np.ndarray) -> np.ndarray:
    """Sources (..., N, N) to solutions with a zero boundary."""
    transformed = dstn(source, type=1, norm="ortho", axes=(-2, -1))
    return dstn(transformed / eigenvalues(source.shape[-1]), type=1, norm="ortho", axes=(-2, -1))
