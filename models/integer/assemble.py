"""From a scene and quantised layers to the integer pipeline: all its tables, and the widths of its words."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.models.integer.depth import Depth, DisplacementQuantiser
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_force import DotForce
from fastac.models.integer.dot_order import in_order, order_like
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.integer.laplacian import STENCILS, boundary_term, divergence_of
from fastac.models.integer.network import GradientRatio, Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.solvers import SOLVERS
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import Fixed, to_words
from fastac.scenes.schema import Scene


def quantise_weights(weights: np.ndarray, bits: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (axes, …) as integers of `bits`, and integer units per unit of the weights, (axes,)."""
    largest = np.abs(weights).reshape(len(weights), -1).max(axis=1)
    scale = ((1 << (bits - 1)) - 1) / np.maximum(largest, 1e-12)
    shape = (-1,) + (1,) * (weights.ndim - 1)
    return np.rint(weights * scale.reshape(shape)).astype(np.int64), scale


def with_loadable(pipeline: IntegerPipeline, loadable: bool) -> IntegerPipeline:
    """The pipeline for hardware whose network, thresholds of darkness and dots can be loaded, or cannot."""
    layers = tuple(replace(layer, loadable=loadable) for layer in pipeline.layers)

    def with_windows(stage):
        return stage and replace(stage, windows=replace(stage.windows, loadable=loadable))

    follower, dot_force = with_windows(pipeline.follower), pipeline.dot_force
    if dot_force is not None:
        dot_force = replace(dot_force, weighted=replace(dot_force.weighted, input_width=follower.width))
    return pipeline.replace(
        layers=layers,
        ratio=replace(pipeline.ratio, normal_width=layers[-1].accumulator_width),
        bridge=with_windows(pipeline.bridge),
        follower=follower,
        dot_force=dot_force,
    )


def assemble(
    scene: Scene,
    *,
    layers: tuple[Layer, ...],
    background: np.ndarray,
    rest_depth_mm: np.ndarray,
    bridge: SlopeBridge | None = None,
    follower: DotFollower | None = None,
) -> IntegerPipeline:
    """The integer pipeline up to the depth and the displacement; `with_force` adds the force's weights,
    `with_limits` what makes a frame suspect.

    bridge, follower : of the background's dots, where the scene wants them; where both are, the follower's
        thresholds are those of both

    Only what the scene wants is computed: no depth wanted, no solver. Widths follow from bounds
    (models/integer/bounds.py), of any weights where the scene's are loadable. Raises ValueError where a bound
    does not fit the scene's data bits.
    """
    numbers, pitch = scene.numbers, scene.sensor.pitch_mm
    loadable = scene.hardware.weights == "loadable"
    ratio = GradientRatio(
        normal_width=layers[-1].accumulator_width,
        width=numbers.slope_bits,
        fraction=numbers.gradient_fraction_bits,
    )
    pipeline = IntegerPipeline(
        scene=scene,
        layers=layers,
        ratio=ratio,
        background=background,
        rest_depth_mm=rest_depth_mm,
        validity=FrameValidity.unlimited(
            background.shape,
            slopes=scene.wants_slopes,
            displacements=scene.force_from_displacement,
            dots=len(follower.rest) if follower is not None else 0,
        ),
        bridge=bridge,
        follower=follower,
    )
    if bridge is not None and follower is not None:
        pipeline = pipeline.replace(bridge=replace(bridge, windows=follower.windows))
    pipeline = with_loadable(pipeline, loadable)
    ratio = pipeline.ratio
    if not scene.wants_solver:
        return pipeline

    divergence = scene.poisson.divergence
    unit = Fixed(62, ratio.fraction + STENCILS[divergence].fraction_bits)
    rest_slopes = pipeline.slopes_of(background[None])[0]
    if scene.poisson.mode == "difference":
        offset = divergence_of(rest_slopes, divergence)[0]
    else:
        offset = to_words(boundary_term(rest_depth_mm / pitch), unit)
    # The slopes at rest follow from the network: where it is loadable, they may be any.
    any_rest = loadable and scene.poisson.mode == "difference"
    source = PoissonSource(divergence, ratio.width, offset, 4 * ratio.limit if any_rest else None)
    slope_limit = ratio.limit * 2.0**-ratio.fraction
    # Its many small products are slower on several threads, and bounds then depend on the machine.
    with threadpool_limits(1):
        constant = np.zeros_like(offset) if any_rest else offset
        chosen = _fitted(
            SOLVERS[scene.poisson.solver],
            constant.tobytes(),
            source=Fixed(source.width, unit.fraction),
            slope_limit=2 * slope_limit if any_rest else slope_limit,
            divergence=divergence,
            coefficient_fraction=numbers.coefficient_fraction_bits,
            data_bits=numbers.data_bits,
            rounding=numbers.rounding,
        )
    if scene.poisson.mode == "difference":
        rest = to_words(rest_depth_mm[1:-1, 1:-1] / pitch, Fixed(62, chosen.depth_format.fraction))
    else:
        rest = chosen(source(rest_slopes))[0]
    other_rest = loadable and scene.poisson.mode == "absolute"
    depth = Depth(scene.poisson.mode, chosen.depth_format.width, rest, other_rest)
    quantiser = None
    if scene.force_from_displacement:
        largest = scene.force.max_displacement_mm / pitch * 2.0**chosen.depth_format.fraction
        magnitude_bits = numbers.displacement_bits - scene.force.signed
        shift = max(int(largest).bit_length() - magnitude_bits, 0)
        quantiser = DisplacementQuantiser(
            depth.width, shift, numbers.displacement_bits, not scene.force.signed
        )
    return pipeline.replace(source=source, solver=chosen, depth=depth, quantiser=quantiser)


@lru_cache(maxsize=16)
def _fitted(kind: type[IntegerSolver], offset: bytes, **facts) -> IntegerSolver:
    """`kind.fitted` with an `offset` of int64; kept for the next scene with the same words, as a table of
    scenes or a sweep has many."""
    words = np.frombuffer(offset, np.int64)
    side = math.isqrt(len(words))
    return kind.fitted(offset=words.reshape(side, side), **facts)


def with_force(
    pipeline: IntegerPipeline, weights: np.ndarray, dot_weights: np.ndarray | None = None
) -> IntegerPipeline:
    """The pipeline with the force model's weights.

    weights : HyperForce's kernels (axes, N, N, K, K) or one weight a pixel and term (axes, N, N, terms), in
        N per mm of displacement; for the adjoint the weights of the slopes (axes, H, W, 2), in N. Every axis
        has a scale of its own. With `force.block_px` above 1 the same in each square, as `block_means` has
        them.
    dot_weights : (axes, M, 2) in N per px of the dots' shifts, where the scene wants them
    """
    found = _with_skin_force(pipeline, weights)
    if pipeline.follower is None:
        return found
    bits = pipeline.scene.numbers.dot_weight_bits
    return found.replace(
        dot_force=DotForce.of_weights(dot_weights, found.force_n_per_unit, pipeline.follower, bits)
    )


def _with_skin_force(pipeline: IntegerPipeline, weights: np.ndarray) -> IntegerPipeline:
    """The pipeline with weights of the displacement or the slopes, as `with_force`."""
    scene, numbers = pipeline.scene, pipeline.scene.numbers
    if scene.force_from_slopes:
        words, scale = quantise_weights(weights, numbers.slope_weight_bits)
        force = WeightedSum(
            words,
            _constant(pipeline, words),
            pipeline.ratio.width,
            input_signed=True,
            loadable=scene.hardware.weights == "loadable",
            block_px=scene.force.block_px,
        )
        return pipeline.replace(force=force, force_n_per_unit=2.0**-pipeline.ratio.fraction / scale)
    words, scale = quantise_weights(weights, numbers.kernel_bits)
    if scene.force_of_weights:
        constant = np.zeros(len(words), np.int64)
        force = WeightedSum(
            words,
            constant,
            numbers.displacement_bits,
            scene.force.signed,
            block_px=scene.force.block_px,
        )
        return pipeline.replace(force=force, force_n_per_unit=pipeline.displacement_mm_per_unit / scale)
    force = PatchForce(words, numbers.kernel_bits, numbers.displacement_bits, not scene.force.clamp)
    if scene.force.kernel == "collapsed":
        force = force.collapsed()
    return pipeline.replace(force=force, force_n_per_unit=pipeline.displacement_mm_per_unit / scale)


def with_force_of(pipeline: IntegerPipeline, known: IntegerPipeline) -> IntegerPipeline:
    """The pipeline with the integers of another one's force, as the hardware of that one has them.

    Dots are brought into the order of those of `known`, whose weights they get: each is the one whose place
    at rest is nearest to its own. Raises ValueError as `order_of_dots`.
    """
    force, follower = known.force, pipeline.follower
    if follower is not None and known.follower is not None:
        follower = in_order(follower, order_of_dots(pipeline, known), known.follower)
    if pipeline.scene.force_from_slopes:
        force = replace(force, constant=_constant(pipeline, force.weight))
    return pipeline.replace(
        force=force,
        force_n_per_unit=known.force_n_per_unit,
        follower=follower,
        dot_force=known.dot_force,
        interval=known.interval,
    )


def order_of_dots(pipeline: IntegerPipeline, known: IntegerPipeline) -> np.ndarray:
    """The index of the pipeline's dot that is at each place of those of `known`, (M,).

    Raises ValueError, one line, unless all dots have a partner within half their spacing.
    """
    dots, pitch_mm = pipeline.scene.sensor.markers, pipeline.scene.sensor.pitch_mm
    return order_like(pipeline.follower, known.follower, dots.spacing_mm / pitch_mm / 2)


def _constant(pipeline: IntegerPipeline, weight: np.ndarray) -> np.ndarray:
    """Per axis, what the adjoint's weights of the slopes (axes, H, W, 2) must add for no force at rest."""
    rest, _ = pipeline.slopes_of(pipeline.background[None])
    return -(weight * rest).sum(axis=(1, 2, 3))
