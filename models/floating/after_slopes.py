"""The float pipeline's tables behind the slopes: displacement and force of the slopes' change from the
background.

Solver and force weights are linear, so that the background gives exactly zero.
"""

from functools import cached_property

import numpy as np

from fastac.models.integer.force import terms
from fastac.models.integer.laplacian import STENCILS, eigenvalues, sine_matrix
from fastac.models.loops.pixels import source
from fastac.models.loops.sines import FoldedSine


class AfterSlopes:
    """What is the same for all frames of a FloatPipeline, `pipeline`.

    rest_slopes : (2, H · W), those that the network gives for the background frame
    solves : whether there is a depth solver; then
        sine : the transform of rows and columns; factors : see `loops.poisson.divide_modes`
        rest_source : (N · N,) the source of the slopes at rest
    weight : (axes, terms, pixels) of the force, float64; without a force, no elements
    """

    def __init__(self, pipeline):
        scene = pipeline.scene
        self.pipeline = pipeline
        self.stencil, self.solves = STENCILS[scene.poisson.divergence], scene.wants_solver
        height, width = pipeline.background.shape[:2]
        self.rest_slopes = np.ascontiguousarray(np.moveaxis(pipeline.rest_slopes(), -1, 0).reshape(2, -1))
        if self.solves:
            size, scale = height - 2, np.float32(self.stencil.scale)
            self.rest_source = np.zeros(size * size, np.float32)
            nothing = np.zeros_like(self.rest_source)
            source(self.rest_slopes, width, 0, self.stencil.ahead, scale, nothing, self.rest_source)
            self.sine = FoldedSine(sine_matrix(size).astype(np.float32))
            reciprocal = (-scene.sensor.pitch_mm / eigenvalues(size)).astype(np.float32)
            self.factors = self.sine.in_blocks(self.sine.by_modes(reciprocal.T).T)
        self.weight = np.empty((0, 0, 0))
        if pipeline.force_weights is not None:
            weight = pipeline.pixel_weights
            weight = weight[..., None] if weight.ndim == 3 else weight
            planes = np.moveaxis(weight, -1, 1)
            self.weight = planes.reshape(*planes.shape[:2], -1).astype(np.float64)

    @cached_property
    def rest_mm(self) -> np.ndarray:
        """The depth of the background frame, (H, W) in mm."""
        found = self.pipeline.rest_depth_mm.astype(np.float32)
        found[1:-1, 1:-1] = self.pipeline.rest_px() * self.pipeline.scene.sensor.pitch_mm
        return found

    def force_n(self, x: np.ndarray) -> np.ndarray:
        """The skin's force (axes,) in N, from the displacement (N, N) as it counts."""
        planes = np.moveaxis(terms(x, self.pipeline.scene.force.bends_mm), -1, 0)
        return np.tensordot(self.weight, planes.reshape(len(planes), -1).astype(np.float64), axes=2)
