"""The integer pipeline at full speed: models/integer in floating point, bit for bit.

Every integer of the pipeline is below a bound that follows from its tables. Where that is below 2**53,
float64 holds it, its sums and its multiples by powers of two exactly. So shifts move into the tables and a
rounding is a floor. `ExactTables` refuses tables for which it would not be exact. The network's hidden layers
are in float32 where that holds all their sums.
"""

import numpy as np

from fastac.models.emulator.exactness import EXACT_FLOAT32, require_exact
from fastac.models.emulator.solvers import SOLVERS
from fastac.models.integer.features import limits
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.laplacian import STENCILS
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.loops.network import FrameNetwork


class ExactTables:
    """A pipeline's tables in float64, for any number of threads.

    Raises NotExactError, naming the stage, where an integer could reach 2**53.
    """

    def __init__(self, pipeline: IntegerPipeline):
        self.pipeline = pipeline
        limit = limits(pipeline.background.shape[-1])
        requantise, largest = [], 0
        *hidden, last = pipeline.layers
        for layer in hidden:
            step = layer.requantisation
            reach = np.abs(layer.weight) @ limit + np.abs(layer.bias)
            require_exact("layer", int((reach * step.multiplier).max()))
            top = (1 << step.bits) - 1
            requantise.append((step.multiplier * 2.0**-step.shift, top))
            limit = np.full(len(layer.weight), top, np.int64)
            largest = max(largest, int(reach.max()), top, int(step.multiplier.max()))
        real = np.float32 if largest < EXACT_FLOAT32 else np.float64
        tables = [_layer_table(layer, real) for layer in hidden] + [_layer_table(last, np.float64)]
        self.network = FrameNetwork(
            tables,
            pipeline.background,
            requantise=requantise,
            smoothing_px=pipeline.scene.network.smoothing_px,
        )
        normal = int((np.abs(last.weight) @ limit + np.abs(last.bias)).max())
        require_exact("layer", normal)
        require_exact("slopes", (normal << (pipeline.ratio.fraction + 1)) + 3 * normal)
        self.solver = None
        if pipeline.solver is not None:
            require_exact("source", pipeline.source.bound)
            require_exact("depth", 1 << pipeline.depth.width)
            self.solver = SOLVERS[pipeline.scene.poisson.solver](pipeline.solver)
            self.ahead = STENCILS[pipeline.source.divergence].ahead
            self.offset = pipeline.source.offset.astype(np.float64)
            self.rest = pipeline.depth.rest.astype(np.float64)
        if pipeline.force is not None:
            self._plan_force(pipeline.force)

    def _plan_force(self, force: PatchForce | WeightedSum) -> None:
        resultant = force.collapsed() if isinstance(force, PatchForce) else force
        dots = self.pipeline.dot_force
        require_exact("force", resultant.bound + (dots.bound if dots is not None else 0))
        # Terms before pixels, as slopes are kept: in two planes.
        planes = np.moveaxis(resultant.weight, -1, 1)
        self.weight = planes.reshape(*planes.shape[:2], -1).astype(np.float64)
        self.constant = resultant.constant.astype(np.float64)
        if self.pipeline.scene.wants_force_map:
            require_exact("force_map", force.pixel_bound)
            self.kernel = np.ascontiguousarray(np.moveaxis(force.kernel, (3, 4), (0, 1)).astype(np.float64))


def _layer_table(layer: Layer, real: type) -> np.ndarray:
    """(neurons, inputs + 1), the bias last."""
    return np.column_stack([layer.weight, layer.bias]).astype(real)
