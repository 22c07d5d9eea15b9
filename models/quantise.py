"""From float weights to the integer model: scales, multipliers, kernels, and every word's width."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fastac.models.bounds import solver
from fastac.models.features import limits
from fastac.models.fixed import Fixed, to_words
from fastac.models.integer import (
    Depth,
    DisplacementQuantiser,
    GradientRatio,
    Layer,
    PatchForce,
    PoissonSource,
    Requantisation,
    WeightedSum,
    divergence_of,
)
from fastac.models.pipeline import IntegerPipeline
from fastac.models.poisson import boundary_term
from fastac.models.tridiagonal import tridiagonal_solver
from fastac.models.validity import FrameValidity
from fastac.scenes.schema import Scene

CHOOSERS = {"dst2d": solver, "tridiagonal": tridiagonal_solver}
MULTIPLIER_BITS = 17


def requantisation(scale: np.ndarray, bits: int) -> Requantisation:
    """`scale` (neurons,) > 0, activation units per accumulator unit, as multipliers and one shift.

    The largest multiplier uses all 17 bits; a shift below zero (scales of 2**17 and more) is refused.
    """
    shift = MULTIPLIER_BITS - int(np.floor(np.log2(scale.max()))) - 1
    multiplier = np.rint(scale * 2.0**shift).astype(np.int64)
    if multiplier.max() >> MULTIPLIER_BITS:
        shift -= 1
        multiplier = np.rint(scale * 2.0**shift).astype(np.int64)
    return Requantisation(np.maximum(multiplier, 1), shift, bits)


def quantise_layers(
    weights: Sequence[np.ndarray],
    biases: Sequence[np.ndarray],
    feature_scales: np.ndarray,
    features: np.ndarray,
    *,
    weight_bits: int,
    activation_bits: int,
    last_weight_bits: int,
    percentile: float = 100,
) -> tuple[Layer, ...]:
    """Post-training quantisation of the pixel network.

    weights, biases : of the float layers; feature_scales : float value of one unit of each integer feature
    features : calibration pixels (pixels, inputs), integers; activations' ranges are `percentile` of theirs

    Every hidden neuron has a weight scale and an activation range of its own: its multiplier and the next
    layer's weights absorb both. The last layer has one scale for all neurons, because only the ratios of its
    outputs count. Floors are turned into roundings by half a unit in the bias.
    """
    top_activation = (1 << activation_bits) - 1
    layers = []
    into = features.astype(np.float64) * feature_scales  # float activations
    unit = feature_scales  # float value of one integer unit of each input
    limit = limits(len(feature_scales) - 2)
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        out = np.maximum(into @ weight.T + bias, 0)
        largest = np.percentile(out, percentile, axis=0)
        activation_unit = np.maximum(largest, largest.max() * 1e-3 + 1e-9) / top_activation
        bias = bias + activation_unit / 2
        integer_weight, scale = _scaled(weight * unit, bias, limit, weight_bits, axis=1)
        integer_bias = np.rint(bias / scale).astype(np.int64)
        multiplier = requantisation(scale / activation_unit, activation_bits)
        layers.append(Layer(integer_weight, integer_bias, limit, weight_bits, multiplier))
        into, unit, limit = out, activation_unit, np.full(len(weight), top_activation)
    integer_weight, scale = _scaled(weights[-1] * unit, biases[-1], limit, last_weight_bits, axis=None)
    integer_bias = np.rint(biases[-1] / scale).astype(np.int64)
    return (*layers, Layer(integer_weight, integer_bias, limit, last_weight_bits))


def _scaled(
    weight: np.ndarray, bias: np.ndarray, limit: np.ndarray, bits: int, axis: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Weights (neurons, inputs) as integers of `bits`, and each neuron's scale; one for all if no axis.

    No bias (neurons,) is then larger than the weights could make the sum over inputs up to `limit`: so much
    room a loadable one has.
    """
    top = (1 << (bits - 1)) - 1
    magnitude = np.abs(weight)
    largest = np.hstack([magnitude, np.abs(bias)[:, None] / limit.sum()])
    scale = largest.max(axis=axis, keepdims=True) / top
    # A neuron whose weights have died keeps a scale that its multiplier can express.
    scale = np.broadcast_to(np.maximum(scale, magnitude.max() * 1e-4 / top), (len(weight), 1))
    return np.clip(np.rint(weight / scale), -top, top).astype(np.int64), scale[:, 0]


def quantise_weights(weights: np.ndarray, bits: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (axes, …) as integers of `bits`, and integer units per unit of the weights, (axes,)."""
    largest = np.abs(weights).reshape(len(weights), -1).max(axis=1)
    scale = ((1 << (bits - 1)) - 1) / np.maximum(largest, 1e-12)
    shape = (-1,) + (1,) * (weights.ndim - 1)
    return np.rint(weights * scale.reshape(shape)).astype(np.int64), scale


def assemble(
    scene: Scene,
    *,
    layers: tuple[Layer, ...],
    background: np.ndarray,
    rest_depth_mm: np.ndarray,
) -> IntegerPipeline:
    """The integer pipeline up to the depth and the displacement; `with_force` adds the force's weights,
    `with_limits` what makes a frame suspect.

    Only what the scene wants is computed: no depth wanted, no solver. Widths follow from bounds
    (models/bounds.py), of any weights where the scene's are loadable. Raises ValueError where a bound does
    not fit the scene's data bits.
    """
    numbers, pitch = scene.numbers, scene.sensor.pitch_mm
    loadable = scene.hardware.weights == "loadable"
    layers = tuple(replace(layer, loadable=loadable) for layer in layers)
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
            displacements=scene.wants_force and scene.wants_solver,
        ),
    )
    if not scene.wants_solver:
        return pipeline

    divergence = scene.poisson.divergence
    unit = Fixed(62, ratio.fraction + (divergence == "central"))
    rest_slopes = pipeline.slopes(pipeline.normals(background[None]))[0]
    if scene.poisson.mode == "difference":
        offset = divergence_of(rest_slopes, divergence)[0]
    else:
        offset = to_words(boundary_term(rest_depth_mm / pitch), unit)
    # The slopes at rest follow from the network: where it is loadable, they may be any.
    any_rest = loadable and scene.poisson.mode == "difference"
    source = PoissonSource(divergence, ratio.width, offset, 4 * ratio.limit if any_rest else None)
    slope_limit = ratio.limit * 2.0**-ratio.fraction
    chosen = CHOOSERS[scene.poisson.solver](
        offset=np.zeros_like(offset) if any_rest else offset,
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
    if scene.wants_force:
        largest = scene.force.max_displacement_mm / pitch * 2.0**chosen.depth_format.fraction
        magnitude_bits = numbers.displacement_bits - (not scene.force.clamp)
        shift = max(int(largest).bit_length() - magnitude_bits, 0)
        quantiser = DisplacementQuantiser(depth.width, shift, numbers.displacement_bits, scene.force.clamp)
    return pipeline.replace(source=source, solver=chosen, depth=depth, quantiser=quantiser)


def with_force(pipeline: IntegerPipeline, weights: np.ndarray) -> IntegerPipeline:
    """The pipeline with the force model's weights.

    weights : HyperForce's kernels (axes, N, N, K, K), in N per mm of displacement; for the adjoint the
        weights of the slopes (axes, H, W, 2), in N. Every axis has a scale of its own.
    """
    scene, numbers = pipeline.scene, pipeline.scene.numbers
    if scene.wants_adjoint:
        words, scale = quantise_weights(weights, numbers.slope_weight_bits)
        force = WeightedSum(
            words,
            _constant(pipeline, words),
            pipeline.ratio.width,
            input_signed=True,
            loadable=scene.hardware.weights == "loadable",
        )
        return pipeline.replace(force=force, force_n_per_unit=2.0**-pipeline.ratio.fraction / scale)
    words, scale = quantise_weights(weights, numbers.kernel_bits)
    force = PatchForce(words, numbers.kernel_bits, numbers.displacement_bits, not scene.force.clamp)
    if scene.force.kernel == "collapsed":
        force = force.collapsed()
    return pipeline.replace(force=force, force_n_per_unit=pipeline.displacement_mm_per_unit / scale)


def with_limits(pipeline: IntegerPipeline, frames: np.ndarray, *, progress: bool = False) -> IntegerPipeline:
    """The pipeline with limits around what good frames (frames, H, W, C) measure; see `FrameValidity`."""
    found = pipeline.run(frames, wanted=["validity_measures"], progress=progress)
    return pipeline.replace(validity=pipeline.validity.limited(found.validity_measures))


def with_force_of(pipeline: IntegerPipeline, known: IntegerPipeline) -> IntegerPipeline:
    """The pipeline with the integers of another one's force, as the hardware of that one has them."""
    force = known.force
    if pipeline.scene.wants_adjoint:
        force = replace(force, constant=_constant(pipeline, force.weight))
    return pipeline.replace(force=force, force_n_per_unit=known.force_n_per_unit)


def _constant(pipeline: IntegerPipeline, weight: np.ndarray) -> np.ndarray:
    """Per axis, what the adjoint's weights of the slopes (axes, H, W, 2) must add for no force at rest."""
    rest, _ = pipeline.slopes(pipeline.normals(pipeline.background[None]))
    return -(weight * rest).sum(axis=(1, 2, 3))


def layers_to_arrays(layers: Sequence[Layer]) -> dict[str, np.ndarray]:
    """Layers as named arrays, for a file between two steps of a build."""
    arrays = {}
    for k, layer in enumerate(layers):
        arrays |= {f"layer.{k}.{name}": getattr(layer, name) for name in ("weight", "bias", "input_limit")}
        arrays[f"layer.{k}.weight_bits"] = np.array(layer.weight_bits)
        if layer.requantisation is not None:
            scale = layer.requantisation
            arrays[f"layer.{k}.multiplier"] = scale.multiplier
            arrays[f"layer.{k}.shift_bits"] = np.array([scale.shift, scale.bits])
    return arrays


def layers_from_arrays(arrays: dict[str, np.ndarray]) -> tuple[Layer, ...]:
    """The inverse of `layers_to_arrays`."""
    layers = []
    while f"layer.{len(layers)}.weight" in arrays:
        part = f"layer.{len(layers)}."
        scale = None
        if f"{part}multiplier" in arrays:
            scale = Requantisation(arrays[f"{part}multiplier"], *map(int, arrays[f"{part}shift_bits"]))
        layers.append(
            Layer(
                arrays[f"{part}weight"],
                arrays[f"{part}bias"],
                arrays[f"{part}input_limit"],
                int(arrays[f"{part}weight_bits"]),
                scale,
            )
        )
    return tuple(layers)
