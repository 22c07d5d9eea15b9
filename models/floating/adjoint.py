"""Force from slopes without solving for depth: weights from the adjoint of the discrete Poisson solver.

Without the clamp everything from the slopes to the resultant is linear. With g the slopes, D the divergence,
L the 5-point Laplacian on the inner region with a zero boundary, and w a weight per inner pixel,

    F = −pitch · wᵀ L⁻¹ D (g − g_rest) = Σ (a·p + b·q) + constant,   (a, b) = −pitch · Dᵀ L⁻¹ w,

as L is symmetric. Prior and background meet only the constant −Σ (a·p_rest + b·q_rest), in both modes.
"""

import numpy as np

from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer.laplacian import STENCILS, transposed_differences


def transposed_divergence(g: np.ndarray, divergence: str) -> np.ndarray:
    """Dᵀ of `poisson.source_of`: fields (..., N, N) to weights of the slopes (..., N + 2, N + 2, 2)."""
    return STENCILS[divergence].scale * transposed_differences(g, divergence)


def slope_weights(weight: np.ndarray, divergence: str, pitch_mm: float) -> np.ndarray:
    """Weights of the slopes, (axes, H, W, 2) in N, from weights of the displacement, (axes, N, N) in N per
    mm."""
    return -pitch_mm * transposed_divergence(solve(weight), divergence)


def displacement_mm(change: np.ndarray, divergence: str, pitch_mm: float) -> np.ndarray:
    """The displacement −pitch · L⁻¹ D change, (..., N, N) in mm; `change` is the slopes less those of the
    background, (..., H, W, 2)."""
    return -pitch_mm * solve(source_of(change, divergence))
