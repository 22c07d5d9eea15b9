"""The integer pipeline as ONNX, bit for bit: int32 and int64 nodes that do what models/integer defines.

Doubles appear only where words become physical units, as in the emulator: products and roots of integers
below 2**53, rounded once.
"""

from collections.abc import Callable

import numpy as np

from fastac.export.graph import FRAMES, Graph, require_room
from fastac.export.pixel_stages import bridge_columns, bridged, divergence, force_map, smoothed, terms
from fastac.export.solver_stages import solution
from fastac.models.integer.features import coordinate_codes
from fastac.models.integer.force import PatchForce
from fastac.models.integer.frame_validity import REASONS
from fastac.models.integer.network import GradientRatio, Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.words import FLOOR, NEAREST

Output = Callable[[str, str, type, tuple, str], None]
"""`Graph.output`, which may change the name."""


def add_integers(graph: Graph, pipeline: IntegerPipeline, frames: str, background: str) -> None:
    """Add everything that the scene wants of frames (frames, H, W, C) int32, as outputs of the graph.

    background : (H, W, C) int32
    Outputs have the names and, but for the slopes, the types of `models/result.py`.
    """
    height, width, _ = pipeline.background.shape
    image, inner, scene = (FRAMES, height, width), (FRAMES, height - 2, width - 2), pipeline.scene
    difference = graph.node("Sub", frames, background)
    seen = smoothed(graph, difference, scene.network.smoothing_px, pipeline.background.shape)
    normals = network(graph, pipeline, seen)
    graph.output(normals, "normal_words", np.int32, (*image, 3), "normals of any length, in words")
    graph.output(_unit(graph, normals), "normals", np.float32, (*image, 3), "unit normals, 1")
    slopes, saturated = slopes_of(graph, pipeline.ratio, normals)
    if pipeline.bridge is not None:
        columns = bridge_columns(graph, pipeline.bridge, frames, height, width)
        slopes, saturated = (bridged(graph, value, columns) for value in (slopes, saturated))
    text = f"slopes p, q in units of 2**-{pipeline.ratio.fraction}"
    graph.output(slopes, "slope_words", np.int32, (*image, 2), text)
    counts = {"gradient": graph.sum_over(saturated, 1, 2, 3)}
    graph.output(counts["gradient"], "gradient_saturated", np.int64, (FRAMES,), "slopes that saturated")
    force_input = [slopes]
    if pipeline.solver is not None:
        source = divergence(graph, slopes, pipeline.source.divergence, height, width)
        z = solution(graph, pipeline.solver, graph.node("Sub", source, pipeline.source.offset))
        displacement = _depth(graph, pipeline, z)
        if pipeline.quantiser is not None:
            words, counts["displacement"] = _quantised(graph, pipeline, displacement)
            force_input = terms(graph, words, tuple(np.int64(bend) for bend in pipeline.bends))
    if pipeline.force is not None:
        _force(graph, pipeline, force_input)
        if scene.wants_force_map:
            raw = force_map(graph, words, pipeline.force.kernel)
            axes = (FRAMES, len(scene.force_axes), *inner[1:])
            graph.output(raw, "force_map_raw", np.int64, axes, "accumulators")
            newtons = _real(graph, raw, pipeline.force_n_per_unit[:, None, None])
            graph.output(newtons, "force_map_n", np.float32, axes, "share of each inner pixel, N")
    _validity(graph, pipeline, frames, difference, counts)


def network(graph: Graph, pipeline: IntegerPipeline, difference: str) -> str:
    """The pixel network's outputs (frames, H, W, 3) from differences (frames, H, W, C), smoothed or not."""
    height, width, channels = pipeline.background.shape
    codes = np.empty((height, width, 2), np.int64)
    codes[..., 0], codes[..., 1] = coordinate_codes(width), coordinate_codes(height)[:, None]
    first, *others = pipeline.layers
    # The coordinates are the same in every frame, so that their share of the first sums is a table.
    share = codes @ first.weight[:, channels:].T + first.bias
    x = graph.linear(difference, first.weight[:, :channels].T, share, first.accumulator_bound)
    x = _requantised(graph, first, x)
    for layer in others:
        x = graph.linear(x, layer.weight.T, layer.bias, layer.accumulator_bound)
        x = _requantised(graph, layer, x)
    return x


def _requantised(graph: Graph, layer: Layer, sums: str) -> str:
    step = layer.requantisation
    if step is None:
        return sums
    products = graph.node("Mul", graph.node("Max", sums, 0), step.multiplier.astype(np.int64))
    bound = layer.accumulator_bound * int(step.multiplier.max())
    shifted = graph.round_shift(products, step.shift, FLOOR, bound, signed=False)
    return graph.clip(shifted, None, (1 << step.bits) - 1)


def _unit(graph: Graph, normals: str) -> str:
    """Normal words to unit vectors in double: their squares' sum is exact below 2**53."""
    real = graph.cast(normals, np.float64)
    squares = graph.node("ReduceSum", graph.node("Mul", real, real), np.array([3]), keepdims=1)
    return graph.node("Div", real, graph.node("Max", graph.node("Sqrt", squares), np.array(1.0)))


def slopes_of(graph: Graph, ratio: GradientRatio, normals: str) -> tuple[str, str]:
    """`GradientRatio`: normals (frames, H, W, 3) to slopes (frames, H, W, 2), and 1 where one saturated."""
    require_room("normal", 1 << (ratio.normal_width + ratio.fraction + 1))
    across = graph.axis_slices(normals, {3: (0, 2)})
    along = graph.axis_slices(normals, {3: (2, 3)})
    upwards = graph.node("Greater", along, 0)
    divisor = graph.node("Where", upwards, along, 1)
    scaled = graph.node("Mul", graph.node("Abs", across), 1 << (ratio.fraction + 1))
    # Neither is negative: rounding towards zero is a floor.
    quotient = graph.node("Div", graph.node("Add", scaled, divisor), graph.node("Mul", divisor, 2))
    steep = graph.node("Where", graph.node("Equal", across, 0), 0, ratio.limit)
    magnitude = graph.node("Where", upwards, quotient, steep)
    beyond = graph.node("Or", graph.node("Greater", magnitude, ratio.limit), graph.node("Not", upwards))
    limited = graph.node("Min", magnitude, ratio.limit)
    slopes = graph.node("Mul", graph.node("Neg", graph.node("Sign", across)), limited)
    return slopes, graph.cast(beyond, np.int64)


def _real(graph: Graph, words: str, unit) -> str:
    """Words times a unit, in double."""
    return graph.node("Mul", graph.cast(words, np.float64), np.asarray(unit, np.float64))


def _depth(graph: Graph, pipeline: IntegerPipeline, z: str) -> str:
    """Outputs of the depth; returns the displacement's words (frames, N, N)."""
    height, width = pipeline.rest_depth_mm.shape
    rest, unit = pipeline.depth.rest, pipeline.depth_mm_per_unit
    if pipeline.depth.mode == "absolute":
        depth, displacement = z, graph.node("Sub", rest, z)
    else:
        depth, displacement = graph.node("Add", z, rest), graph.node("Neg", z)
    inner = (FRAMES, height - 2, width - 2)
    graph.output(depth, "depth_words", np.int64, inner, f"inner pixels, in units of {unit!r} mm")
    rim = pipeline.rest_depth_mm.astype(np.float64).copy()
    rim[1:-1, 1:-1] = 0
    around = np.array([0, 1, 1, 0, 1, 1], np.int64)
    whole = graph.node("Add", graph.node("Pad", _real(graph, depth, unit), around), rim)
    graph.output(whole, "depth_mm", np.float32, (FRAMES, height, width), "height z of the skin, mm")
    text = "towards the camera, mm"
    graph.output(_real(graph, displacement, unit), "displacement_mm", np.float32, inner, text)
    return displacement


def _quantised(graph: Graph, pipeline: IntegerPipeline, displacement: str) -> tuple[str, str]:
    """The displacement's words for the force (frames, N, N), and how many of each frame saturated."""
    step = pipeline.quantiser
    if step.clamp:
        displacement = graph.node("Max", displacement, 0)
    bound = 1 << (step.input_width - 1)
    scaled = graph.round_shift(displacement, step.shift, NEAREST, bound, signed=not step.clamp)
    over = graph.cast(graph.node("Greater", graph.node("Abs", scaled), step.top), np.int64)
    count = graph.sum_over(over, 1, 2)
    words = graph.clip(scaled, -step.top, step.top)
    inner = tuple(length - 2 for length in pipeline.background.shape[:2])
    unit = pipeline.displacement_mm_per_unit
    graph.output(words, "displacement_words", np.int64, (FRAMES, *inner), f"in units of {unit!r} mm")
    graph.output(count, "displacement_saturated", np.int64, (FRAMES,), "displacements that saturated")
    return words, count


def _force(graph: Graph, pipeline: IntegerPipeline, inputs: list[str]) -> None:
    """Outputs of the resultant force; `inputs` are the terms, or the slopes (frames, H, W, 2) as one."""
    force = pipeline.force
    force = force.collapsed() if isinstance(force, PatchForce) else force
    weight = force.weight if len(inputs) > 1 or force.weight.shape[-1] == 1 else force.weight[..., None]
    raw = None
    for k, value in enumerate(inputs):
        table = weight[..., k].reshape(len(weight), -1).T
        part = graph.linear(graph.node("Flatten", value, axis=1), table, None, force.bound)
        raw = part if raw is None else graph.node("Add", raw, part)
    raw = graph.node("Add", raw, force.constant)
    shape = (FRAMES, len(weight))
    graph.output(raw, "force_raw", np.int64, shape, "accumulators")
    graph.output(_real(graph, raw, pipeline.force_n_per_unit), "force_n", np.float64, shape, "force, N")


def _validity(
    graph: Graph, pipeline: IntegerPipeline, frames: str, difference: str, counts: dict[str, str]
) -> None:
    """The frames' measures and flags, `FrameValidity`."""
    validity, (_, width, _) = pipeline.validity, pipeline.background.shape
    darkest = graph.node("ReduceMin", frames, np.array([3]), keepdims=0)
    brightest = graph.node("ReduceMax", frames, np.array([3]), keepdims=0)
    clipped = graph.node(
        "Or", *(graph.node("Equal", v, np.int32(e)) for v, e in ((darkest, 0), (brightest, 255)))
    )
    right = graph.axis_slices(frames, {2: (1, width)})
    left = graph.axis_slices(frames, {2: (0, width - 1)})
    change, detail = (graph.node("Abs", v) for v in (difference, graph.node("Sub", right, left)))
    one = np.array([1])
    measures = [
        graph.node("Unsqueeze", graph.sum_over(graph.cast(clipped, np.int64), 1, 2), one),
        graph.sum_over(graph.cast(difference, np.int64), 1, 2),
        *(
            graph.node("Unsqueeze", graph.sum_over(graph.cast(v, np.int64), 1, 2, 3), one)
            for v in (change, detail)
        ),
        *(
            graph.node("Unsqueeze", counts[name], one)
            for name in ("gradient", "displacement")
            if name in validity.names
        ),
    ]
    found = graph.node("Concat", *measures, axis=1)
    names = validity.names
    graph.output(found, "validity_measures", np.int64, (FRAMES, len(names)), ", ".join(names))
    low, high = (np.asarray(limit, np.int64) for limit in (validity.low, validity.high))
    outside = graph.node("Or", graph.node("Less", found, low), graph.node("Greater", found, high))
    bits = np.array([1 << REASONS.index(name) for name in names], np.int64)
    flags = graph.sum_over(graph.node("Mul", graph.cast(outside, np.int64), bits), 1)
    text = "bits of why the frame is suspect; 0: it is not"
    graph.output(flags, "validity", np.int64, (FRAMES,), text)
