"""Normals to slopes to depth, differentiable: what training for depth needs of the float pipeline."""

import numpy as np
import torch

from fastac.models.integer.laplacian import STENCILS, boundary_term, divergence_of, eigenvalues, sine_matrix
from fastac.scenes.schema import Scene

SMALLEST_NORMAL_Z = 1e-6
"""By which components are divided at least, so that no gradient is infinite."""


def slopes_of(normal: torch.Tensor, limit: float) -> torch.Tensor:
    """Normals (..., 3) of any length to slopes (..., 2), as `floating.network.slopes_of`."""
    n_z = normal[..., 2:]
    slopes = -normal[..., :2] / n_z.clamp_min(SMALLEST_NORMAL_Z)
    return torch.where(n_z > 0, slopes, -normal[..., :2].sign() * limit).clamp(-limit, limit)


class DepthOfSlopes:
    """Slopes (frames, H, W, 2) to depth (frames, N, N) in pixels, as models/floating/poisson.py.

    In difference mode less the depth at rest. The sine transforms are products of matrices.
    """

    def __init__(self, scene: Scene, rest_depth_mm: np.ndarray):
        """rest_depth_mm : (H, W), of the skin at rest"""
        size, rest_px = scene.inner_px, rest_depth_mm / scene.sensor.pitch_mm

        def constant(values: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(values.astype(np.float32))

        self.divergence, self.absolute = scene.poisson.divergence, scene.poisson.mode == "absolute"
        self.sine, self.reciprocal = constant(sine_matrix(size)), constant(1 / eigenvalues(size))
        self.boundary = constant(boundary_term(rest_px))

    def __call__(self, slopes: torch.Tensor, at_rest: torch.Tensor) -> torch.Tensor:
        """at_rest : (H, W, 2), the slopes that are found at rest"""
        if self.absolute:
            return self._solved(self._source(slopes) - self.boundary)
        return self._solved(self._source(slopes - at_rest))

    def _source(self, slopes: torch.Tensor) -> torch.Tensor:
        return divergence_of(slopes, self.divergence) * STENCILS[self.divergence].scale

    def _solved(self, source: torch.Tensor) -> torch.Tensor:
        return self.sine @ (self.sine @ source @ self.sine * self.reciprocal) @ self.sine
