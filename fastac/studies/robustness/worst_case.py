"""Inputs that drive each stage's words to their largest magnitude, to compare it with the proven bound.

Here: the stages of one pixel and of the force; those of the Poisson solver are in worst_case_solver.py.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from fastac.models.integer.force import PatchForce, WeightedSum, terms
from fastac.models.integer.force_segments import places_of_extremes
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.words import signed_width

SATURATES = "saturates there, and sets its flag"


@dataclass(frozen=True, eq=False)
class WorstCase:
    """A word of a stage, and inputs of the stage that drive it to its largest magnitude.

    width : bits of the word, with a sign also where it has none
    bound : the magnitude that the word's width was chosen for
    range_bound : the largest magnitude for inputs in the stage's own range, by interval arithmetic; smaller
        than `bound` where the bound assumes more
    reached : the largest magnitude of the word on `inputs`, by the stage's integer function
    stage : the stage's tables; loadable ones are replaced by the worst that can be loaded
    inputs, outputs : of the stage; their shapes are the stage's
    """

    name: str
    word: str
    width: int
    bound: int
    range_bound: int
    reached: int
    stage: object = field(repr=False)
    inputs: np.ndarray = field(repr=False)
    outputs: np.ndarray = field(repr=False)
    note: str = ""

    @property
    def percent(self) -> float:
        """`reached` in percent of `range_bound`."""
        return 100 * self.reached / self.range_bound

    @property
    def bound_percent(self) -> float:
        """`reached` in percent of `bound`."""
        return 100 * self.reached / self.bound

    @property
    def head_room_bits(self) -> int:
        """Bits of the signed word that `reached` leaves unused."""
        return self.width - signed_width(self.reached)


def magnitude(values: np.ndarray) -> int:
    """The largest absolute value."""
    return int(np.abs(values).max())


def interval(weight: np.ndarray, low, high, constant=0) -> int:
    """The largest |weight @ x + constant| over rows of `weight` (rows, terms), low <= x <= high."""
    upper = np.maximum(weight * low, weight * high).sum(axis=-1) + constant
    lower = np.minimum(weight * low, weight * high).sum(axis=-1) + constant
    return max(magnitude(upper), magnitude(lower))


def extremes(weight: np.ndarray, low, high) -> np.ndarray:
    """Inputs (2·rows, terms) that maximise each row of weight @ x, then those that minimise it."""
    return np.concatenate([np.where(weight > 0, high, low), np.where(weight > 0, low, high)])


def with_largest_weights(layer: Layer) -> Layer:
    """The layer with the largest loadable weights and biases, positive and negative neuron by neuron."""
    sign = 1 - 2 * (np.arange(len(layer.weight)) % 2)
    weight = np.broadcast_to(layer.weight_limit * sign[:, None], layer.weight.shape)
    return replace(layer, weight=weight.copy(), bias=layer.bias_limit * sign)


def layer_cases(pipeline: IntegerPipeline) -> list[WorstCase]:
    """The accumulator of each layer; with the worst weights and biases where they are loadable."""
    found = []
    for k, layer in enumerate(pipeline.layers):
        if layer.loadable:
            layer = with_largest_weights(layer)
        low = -layer.input_limit if k == 0 else 0 * layer.input_limit  # activations are never negative
        inputs = extremes(layer.weight, low, layer.input_limit)
        outputs = layer.accumulate(inputs)
        found.append(
            WorstCase(
                f"layer {k}",
                "accumulator",
                layer.accumulator_width,
                layer.accumulator_bound,
                interval(layer.weight, low, layer.input_limit, layer.bias),
                magnitude(outputs),
                layer,
                inputs,
                outputs,
                "any weights that can be loaded" if layer.loadable else "",
            )
        )
    return found


def gradient_ratio_case(pipeline: IntegerPipeline) -> WorstCase:
    """Slopes from normals with the largest components that the network's word holds; n_z of every sign."""
    ratio = pipeline.ratio
    top = (1 << (ratio.normal_width - 1)) - 1
    values = np.array([-top, -1, 0, 1, top])
    inputs = np.stack(np.meshgrid(values, values, values, indexing="ij"), axis=-1).reshape(-1, 3)
    outputs, _ = ratio(inputs)
    return WorstCase(
        "gradient ratio",
        "slope",
        ratio.width,
        ratio.limit,
        ratio.limit,
        magnitude(outputs),
        ratio,
        inputs,
        outputs,
        SATURATES,
    )


def depth_cases(pipeline: IntegerPipeline) -> list[WorstCase]:
    """Depth and displacement for the solver's largest words and the highest skin at rest."""
    depth, n = pipeline.depth, len(pipeline.depth.rest)
    top = (1 << (depth.input_width - 1)) - 1
    if depth.loadable:  # any word of the solver, as its own solution at rest is one
        depth = replace(depth, rest=np.full((n, n), top))
    inputs = np.stack([np.full((n, n), top), np.full((n, n), -top - 1)])
    heights, displacements = depth(inputs)
    range_bound = top + 1 + magnitude(depth.rest)
    found = [
        WorstCase(
            "depth",
            "depth, displacement",
            depth.width,
            range_bound,
            range_bound,
            max(magnitude(heights), magnitude(displacements)),
            depth,
            inputs,
            heights,
            "any word of the solver" + ", and any rest that can be loaded" * depth.loadable,
        )
    ]
    if pipeline.quantiser is not None:
        quantiser = pipeline.quantiser
        words, _ = quantiser(displacements)
        found.append(
            WorstCase(
                "displacement",
                "quantised",
                quantiser.bits + quantiser.clamp,
                quantiser.top,
                quantiser.top,
                magnitude(words),
                (depth, quantiser),
                inputs,
                words,
                SATURATES,
            )
        )
    return found


def patch_force_cases(force: PatchForce) -> list[WorstCase]:
    """Response of a pixel and resultant force, for displacements that follow the signs of the kernels."""
    n, half, top = force.kernel.shape[1], force.size // 2, force.displacement_limit
    low = -top if force.signed else 0
    # Words beyond the edge of the image meet no displacement.
    near = np.arange(n)[:, None] + np.arange(force.size) - half
    near = (near >= 0) & (near < n)
    flat = (force.kernel * (near[:, None, :, None] & near[None, :, None, :])).reshape(-1, force.size**2)
    reach = np.maximum(
        np.maximum(flat * low, flat * top).sum(axis=1), -np.minimum(flat * low, flat * top).sum(axis=1)
    )
    axis, row, column = np.unravel_index(reach.argmax(), force.kernel.shape[:3])
    kernel = force.kernel[axis, row, column]
    frames = np.zeros((2, n + 2 * half, n + 2 * half), np.int64)
    window = (slice(row, row + force.size), slice(column, column + force.size))
    for frame, sign in zip(frames, (1, -1), strict=True):
        frame[window] = np.where(sign * kernel > 0, top, low)
    inputs = frames[:, half : half + n, half : half + n]
    collapsed = force.collapsed().weight[..., 0].reshape(len(force.kernel), -1)
    whole = extremes(collapsed, low, top).reshape(-1, n, n)
    outputs = force.force_map(inputs)
    return [
        WorstCase(
            "pixel response",
            "response",
            force.pixel_width,
            force.pixel_bound,
            interval(flat, low, top),
            magnitude(outputs),
            force,
            inputs,
            force(inputs),
            "displacements beyond the image's edge are 0",
        ),
        WorstCase(
            "force",
            "accumulator",
            force.width,
            force.bound,
            interval(collapsed, low, top),
            magnitude(force(whole)),
            force,
            whole,
            force(whole),
            "kernels that overlap cancel: the bound adds the magnitudes of all their words",
        ),
    ]


def weighted_sum_case(pipeline: IntegerPipeline) -> WorstCase:
    """The force as a weighted sum, for inputs with the signs of the weights and the worst constants."""
    force = pipeline.force
    if pipeline.bends:
        return bent_sum_case(force, pipeline.bends)
    top = force.input_limit
    low = -top if force.input_signed else 0
    weight = force.weight.reshape(len(force.weight), -1)
    note = ""
    if force.loadable:  # whatever the slopes at rest are
        force = replace(force, constant=np.abs(weight).sum(axis=1) * top)
        note = "any constant that can be loaded"
    inputs = extremes(weight, low, top).reshape(-1, *force.weight.shape[1:])
    outputs = force(inputs)
    range_bound = interval(weight, low, top, force.constant)
    return WorstCase(
        "force",
        "accumulator",
        force.width,
        force.bound,
        range_bound,
        magnitude(outputs),
        force,
        inputs,
        outputs,
        note,
    )


@dataclass(frozen=True, eq=False)
class BentSum:
    """A weighted sum of the terms of displacements with bends; its inputs are (..., rows, columns, 1)."""

    weighted: WeightedSum
    bends: tuple[int, ...]

    def __call__(self, displacement: np.ndarray) -> np.ndarray:
        return self.weighted(terms(displacement[..., 0], self.bends))


def bent_sum_case(force: WeightedSum, bends: tuple[int, ...]) -> WorstCase:
    """The force for displacements that drive each axis highest and lowest: a pixel's share is linear between
    the ends of the range, the bends and 0."""
    top = force.input_limit
    ends = places_of_extremes(bends, top)
    share = np.einsum("arct,kt->karc", force.weight, terms(ends, bends))
    chosen = np.concatenate([share.argmax(axis=0), share.argmin(axis=0)])
    inputs, stage = ends[chosen][..., None], BentSum(force, bends)
    outputs = stage(inputs)
    reachable = magnitude(np.array([share.max(axis=0).sum(axis=(1, 2)), share.min(axis=0).sum(axis=(1, 2))]))
    note = "the bound adds the magnitudes of all terms of a pixel"
    return WorstCase(
        *("force", "accumulator", force.width, force.bound, reachable, magnitude(outputs)),
        *(stage, inputs, outputs, note),
    )


def dot_force_case(pipeline: IntegerPipeline) -> WorstCase:
    """The dots' share of the force, before it is brought to the skin's unit, for shifts with the weights'
    signs."""
    force = pipeline.dot_force.weighted
    top = force.input_limit
    weight = force.weight.reshape(len(force.weight), -1)
    inputs = extremes(weight, -top, top).reshape(-1, *force.weight.shape[1:])
    outputs = force(inputs)
    return WorstCase(
        *("force of dots", "accumulator", force.width, force.bound, interval(weight, -top, top)),
        *(magnitude(outputs), force, inputs, outputs),
    )


def of_pixels(pipeline: IntegerPipeline) -> list[WorstCase]:
    """Worst cases of every stage that the pipeline has, except the Poisson solver's."""
    found = layer_cases(pipeline)
    if pipeline.scene.wants_slopes:
        found.append(gradient_ratio_case(pipeline))
    if pipeline.depth is not None:
        found += depth_cases(pipeline)
    if isinstance(pipeline.force, PatchForce):
        found += patch_force_cases(pipeline.force)
    elif pipeline.force is not None:
        found.append(weighted_sum_case(pipeline))
    if pipeline.dot_force is not None:
        found.append(dot_force_case(pipeline))
    return found
