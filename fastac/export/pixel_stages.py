"""Stages that integers and floats share as ONNX: smoothing, divergence, bridged slopes, terms, force maps."""

import numpy as np

from fastac.export.graph import Graph
from fastac.models.integer.dot_windows import BLOCK
from fastac.models.integer.features import limits
from fastac.models.integer.laplacian import STENCILS
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.integer.smoothing import shift
from fastac.models.integer.words import NEAREST


def smoothed(graph: Graph, difference: str, window_px: int, shape: tuple[int, int, int]) -> str:
    """`smoothing.smoothed` of ΔI (frames, H, W, C) int32, words of that shape.

    window_px : 0: ΔI stays as it is; shape : (H, W, C)
    """
    if not window_px:
        return difference
    height, width, channels = shape
    half = window_px // 2
    around = np.array([0, half, half, 0, 0, half, half, 0], np.int64)
    total = graph.node("Pad", difference, around, mode="edge")
    # The weights 1, 2, …, 2, 1 are those of pairs of neighbours, summed over a window by doubling it.
    steps = [1, *(1 << k for k in range(window_px.bit_length() - 1))]
    for axis, length in ((1, height), (2, width)):
        count = length + window_px
        for step in steps:
            count -= step
            earlier, later = (graph.axis_slices(total, {axis: (at, at + count)}) for at in (0, step))
            total = graph.node("Add", earlier, later)
    bound = int(limits(channels)[0]) << shift(window_px)
    return graph.round_shift(graph.cast(total, np.int64), shift(window_px), NEAREST, bound)


def divergence(graph: Graph, slopes: str, kind: str, height: int, width: int) -> str:
    """`laplacian.divergence_of` of slopes (frames, H, W, 2), (frames, H − 2, W − 2)."""
    span, inner = STENCILS[kind].span, {1: (1, height - 1), 2: (1, width - 1)}
    parts = []
    for component, axis in enumerate((2, 1)):
        plane = graph.node("Gather", slopes, component, axis=3)
        count = (width if axis == 2 else height) - 2
        later = graph.axis_slices(plane, inner | {axis: (span, span + count)})
        earlier = graph.axis_slices(plane, inner | {axis: (0, count)})
        parts.append(graph.node("Sub", later, earlier))
    return graph.node("Add", *parts)


def bridge_columns(graph: Graph, bridge: SlopeBridge, frames: str, height: int, width: int) -> str:
    """`SlopeBridge.columns` of frames (frames, H, W, C) int32, for both slopes: (frames, H, W, 2) int64."""
    threshold = np.kron(bridge.windows.threshold, np.ones((BLOCK, BLOCK), np.int64)).astype(np.int32)
    dark = graph.node("Less", graph.sum_over(frames, 3), threshold)
    skin = graph.node("Cast", graph.node("Not", dark), to=6)  # int32: ONNX pads no booleans everywhere
    own = np.broadcast_to(np.arange(width), (height, width)).astype(np.int64)
    still_dark, reach = dark, bridge.reach
    padded = graph.node("Pad", skin, np.array([0, 0, reach, 0, 0, reach], np.int64))
    found = graph.node("Add", graph.node("Mul", graph.cast(dark, np.int64), 0), own)
    for distance in range(1, reach + 1):
        for step in (-distance, distance):
            beside = graph.axis_slices(padded, {2: (reach + step, reach + step + width)})
            takes = graph.node("And", still_dark, graph.cast(beside, np.bool_))
            found = graph.node("Where", takes, own + step, found)
            still_dark = graph.node("And", still_dark, graph.node("Not", graph.cast(beside, np.bool_)))
    return graph.node("Expand", graph.node("Unsqueeze", found, np.array([3])), np.array([1, 1, 1, 2]))


def bridged(graph: Graph, values: str, columns: str) -> str:
    """Values (frames, H, W, 2) with those of the columns that `bridge_columns` found."""
    return graph.node("GatherElements", values, columns, axis=2)


def terms(graph: Graph, displacement: str, bends: tuple) -> list[str]:
    """`force.terms` of a displacement (frames, N, N): each a value of that shape.

    bends : in the displacement's unit and type
    """
    found = [displacement]
    if not bends:
        return found
    band, *deep = bends
    zero = band * 0
    found.append(graph.node("Max", graph.node("Sub", displacement, band), zero))
    found.append(graph.node("Min", graph.node("Add", displacement, band), zero))
    return found + [graph.node("Max", graph.node("Sub", displacement, d), zero) for d in deep]


def force_map(graph: Graph, displacement: str, kernel: np.ndarray) -> str:
    """Responses (frames, axes, N, N) of kernels (axes, N, N, K, K) to a displacement (frames, N, N)."""
    size, side = kernel.shape[1], kernel.shape[-1]
    half, total = side // 2, None
    around = np.array([0, half, half, 0, half, half], np.int64)
    padded = graph.node("Unsqueeze", graph.node("Pad", displacement, around), np.array([1]))
    for i in range(side):
        for j in range(side):
            moved = graph.axis_slices(padded, {2: (i, i + size), 3: (j, j + size)})
            product = graph.node("Mul", moved, kernel[..., i, j])
            total = product if total is None else graph.node("Add", total, product)
    return total
