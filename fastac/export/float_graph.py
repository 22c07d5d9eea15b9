"""The float pipeline as ONNX: `FloatPipeline` in float32, equal to it but for the order of roundings."""

from collections.abc import Callable

import numpy as np

from fastac.export.graph import FRAMES, Graph
from fastac.export.pixel_stages import bridge_columns, bridged, divergence, force_map, smoothed, terms
from fastac.models.floating.pipeline import KERNELS_NDIM, FloatPipeline
from fastac.models.floating.poisson import source_of
from fastac.models.integer.features import coordinate_codes, scales
from fastac.models.integer.laplacian import STENCILS, eigenvalues, sine_matrix

SHORTEST = np.float32(1e-12)
"""The least length that a normal is divided by."""


def add_floats(graph: Graph, pipeline: FloatPipeline, frames: str, background: str, prefix: str = "") -> None:
    """Add everything that the scene wants of frames (frames, H, W, C) int32, as outputs of the graph.

    background : (H, W, C) int32; prefix : of the outputs' names, which are those of `models/result.py`
    """
    height, width, _ = pipeline.background.shape
    image = (FRAMES, height, width)

    def output(value: str, name: str, dtype: type, shape: tuple, text: str) -> None:
        graph.output(value, prefix + name, dtype, shape, f"{text}; float models")

    difference = graph.node("Sub", frames, background)
    seen = smoothed(graph, difference, pipeline.scene.network.smoothing_px, pipeline.background.shape)
    normals = _network(graph, pipeline, graph.cast(seen, np.float32))
    squares = graph.node("ReduceSum", graph.node("Mul", normals, normals), np.array([3]), keepdims=1)
    length = graph.node("Max", graph.node("Sqrt", squares), SHORTEST)
    output(graph.node("Div", normals, length), "normals", np.float32, (*image, 3), "unit normals, 1")
    slopes = _slopes(graph, normals, np.float32(pipeline.scene.numbers.slope_limit))
    if pipeline.bridge is not None:
        slopes = bridged(graph, slopes, bridge_columns(graph, pipeline.bridge, frames, height, width))
    output(slopes, "slopes", np.float32, (*image, 2), "slopes p, q, 1")
    if pipeline.scene.wants_solver:
        displacement = _solved(graph, pipeline, slopes, output)
        if not pipeline.scene.force.signed:
            displacement = graph.node("Max", displacement, np.float32(0))
        bends = tuple(np.float32(bend) for bend in pipeline.scene.force.bends_mm)
        inputs = terms(graph, displacement, bends)
    if not pipeline.scene.force_from_displacement:
        inputs = [graph.node("Sub", slopes, pipeline.rest_slopes().astype(np.float32))]
    if pipeline.scene.wants_force and pipeline.force_weights is not None:
        _force(graph, pipeline, inputs, output)
        if pipeline.scene.wants_force_map:
            found = force_map(graph, inputs[0], pipeline.force_weights.astype(np.float32))
            shape = (FRAMES, len(pipeline.force_weights), height - 2, width - 2)
            output(found, "force_map_n", np.float32, shape, "share of each inner pixel, N")


def _network(graph: Graph, pipeline: FloatPipeline, difference: str) -> str:
    """The pixel network's outputs (frames, H, W, 3), of any length."""
    height, width, channels = pipeline.background.shape
    codes = np.empty((height, width, 2))
    codes[..., 0], codes[..., 1] = coordinate_codes(width), coordinate_codes(height)[:, None]
    layers = [
        (layer.weight.detach().numpy(), layer.bias.detach().numpy())
        for layer in pipeline.network.linear_layers
    ]
    weight, bias = layers[0]
    weight = (weight * scales(channels)).astype(np.float32)
    x = graph.node("MatMul", difference, weight[:, :channels].T)
    x = graph.node("Add", x, (codes @ weight[:, channels:].T + bias).astype(np.float32))
    for weight, bias in layers[1:]:
        x = graph.node("Add", graph.node("MatMul", graph.node("Relu", x), weight.T), bias)
    return x


def _slopes(graph: Graph, normals: str, limit: np.float32) -> str:
    """−n_x/n_z and −n_y/n_z within ±limit; ±limit, with the sign of the component, where n_z <= 0."""
    across = graph.axis_slices(normals, {3: (0, 2)})
    along = graph.axis_slices(normals, {3: (2, 3)})
    upwards = graph.node("Greater", along, np.float32(0))
    quotient = graph.node("Div", across, graph.node("Where", upwards, along, np.float32(1)))
    steep = graph.node("Mul", graph.node("Sign", across), limit)
    slopes = graph.node("Neg", graph.node("Where", upwards, quotient, steep))
    return graph.node("Clip", slopes, -limit, limit)


def _solved(graph: Graph, pipeline: FloatPipeline, slopes: str, output: Callable) -> str:
    """Outputs of the depth; returns the displacement (frames, N, N) in mm."""
    scene, (height, width, _) = pipeline.scene, pipeline.background.shape
    kind, size = scene.poisson.divergence, height - 2
    # From the slopes less those of the background, so that the background's displacement is zero.
    rest = source_of(pipeline.rest_slopes(), kind).astype(np.float32)
    found = divergence(graph, slopes, kind, height, width)
    found = graph.node("Sub", graph.node("Mul", found, np.float32(STENCILS[kind].scale)), rest)
    sines = sine_matrix(size).astype(np.float32)
    found = graph.node("MatMul", sines, graph.node("MatMul", found, sines))
    found = graph.node("Mul", found, (-scene.sensor.pitch_mm / eigenvalues(size)).astype(np.float32))
    found = graph.node("MatMul", sines, graph.node("MatMul", found, sines))
    inner = (FRAMES, size, size)
    output(found, "displacement_mm", np.float32, inner, "towards the camera, mm")
    rest_mm = pipeline.rest_depth_mm.astype(np.float32)
    rest_mm[1:-1, 1:-1] = pipeline.rest_px() * scene.sensor.pitch_mm
    padded = graph.node("Pad", found, np.array([0, 1, 1, 0, 1, 1], np.int64))
    depth = graph.node("Sub", rest_mm, padded)
    output(depth, "depth_mm", np.float32, (FRAMES, height, width), "height z of the skin, mm")
    return found


def _force(graph: Graph, pipeline: FloatPipeline, inputs: list[str], output: Callable) -> None:
    """The resultant from the terms, or from the slopes' change (frames, H, W, 2) as one, summed in double."""
    weight = pipeline.pixel_weights.astype(np.float64)
    per_term = pipeline.scene.force_from_displacement and pipeline.force_weights.ndim != KERNELS_NDIM
    if not per_term:
        weight = weight.reshape(len(weight), -1, 1)
    total = None
    for k, value in enumerate(inputs):
        flat = graph.cast(graph.node("Flatten", value, axis=1), np.float64)
        part = graph.node("MatMul", flat, weight[..., k].reshape(len(weight), -1).T)
        total = part if total is None else graph.node("Add", total, part)
    output(total, "force_n", np.float64, (FRAMES, len(weight)), "force, N")
