"""An estimate of the energy of a frame, from what the design computes, stores and reads for it.

Operations and memory accesses are counted from the pipeline's tables; no hardware is elaborated. Each has the
energy that Horowitz, "Computing's energy problem", ISSCC 2014, gives for 45 nm, carried to its own word
lengths. The formulas meet his figures: 8 and 32 bits for additions (0.03 and 0.1 pJ) and multiplications
(0.2 and 3.1 pJ), and 64-bit reads of 8 and 32 KB of SRAM (10 and 20 pJ), 1024 and 4096 words deep; a register
is furthest from them. They are figures of standard cells: the wires and switches of an FPGA take more, its
16 nm less. The estimate compares designs and stages; it is no measurement.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from fastac.gateware.arithmetic.packed_products import best_packing
from fastac.gateware.dots.axis import quotient_bits
from fastac.gateware.force.bent_product import offset_adders
from fastac.gateware.force.folded_sum import products_of
from fastac.gateware.force.weighted_sum import rom_width
from fastac.gateware.mlp_mvm import accumulator_ranges, input_ranges, layer_graph
from fastac.gateware.network.requantise import scale_graph
from fastac.gateware.network.slope_bridge import SlopeBridgeStream
from fastac.gateware.slip.rigid_sums import KEPT_FRAMES
from fastac.gateware.slip.spread_ratio import SpreadRatio
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_force import DotForce
from fastac.models.integer.dot_spread import DotSpread
from fastac.models.integer.dot_windows import CELL, DotWindows
from fastac.models.integer.features import WIDTH
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.force_interval import WEIGHT_BITS, ForceInterval
from fastac.models.integer.laplacian import STENCILS
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.integer.words import signed_width
from fastac.synth.estimates.memories import weight_memory
from fastac.synth.estimates.solvers import SOLVERS
from fastac.synth.estimates.work import (
    Frame,
    Work,
    addition,
    memory,
    multiplication,
    register,
    transform_works,
)

MULTIPLIER_BITS = 17
ORIGIN = (
    "estimated: operations of the design × energies at 45 nm after Horowitz, ISSCC 2014: multiplication of"
    " a×b bits 0.2·(ab/64)^0.989 pJ; addition of b bits 0.03 + 0.07·(b − 8)/24 pJ; access to w bits of a"
    " memory d words deep 10·(w/64)·sqrt(d/1024) pJ; each result is written to a register and read from it,"
    " at the energy of a memory one word deep; off-chip, static, clock-tree and control energy excluded"
)


def background_works(frame: Frame) -> Iterator[Work]:
    beats = frame.pixels // frame.lanes
    yield memory(beats, 8 * frame.channels * frame.lanes, beats)
    yield memory(beats, WIDTH * frame.lanes, frame.width // frame.lanes)  # coordinates of the columns
    yield memory(beats, WIDTH, frame.height)
    yield addition(frame.pixels * frame.channels, WIDTH)


def smoothing_works(frame: Frame, window_px: int) -> Iterator[Work]:
    """Rows kept, read and written in each beat; the words of a row's and of a column's window, each in a
    register as it comes and as it is chosen, their sums, and the rounding."""
    beats, row_beats = frame.pixels // frame.lanes, frame.width // frame.lanes
    values, words = frame.pixels * frame.channels, window_px + 1
    of_rows = signed_width(255 * 2 * window_px)
    of_columns = signed_width(255 * (2 * window_px) ** 2)
    yield memory(2 * beats, window_px * frame.lanes * frame.channels * WIDTH, row_beats)
    yield memory(beats, WIDTH * frame.lanes, row_beats)  # coordinates of the columns
    yield memory(beats, WIDTH, frame.height)
    yield register(values * 2 * words, WIDTH)
    beats_held = 2 * -(-window_px // 2 // frame.lanes)
    yield register(values * (beats_held + words), of_rows)
    yield addition(values * window_px, of_rows)
    yield addition(values * window_px, of_columns)
    yield addition(values, of_columns)


def layer_works(frame: Frame, layer: Layer, input_width: int, *, input_signed: bool) -> Iterator[Work]:
    """A layer of the pixel network; `input_width` of an input with its sign. Weights are registers or
    constants, so none are read from a memory."""
    if not layer.loadable:
        yield from baked_works(frame, layer, input_signed=input_signed)
        return
    pixels, (neurons, inputs) = frame.pixels, layer.weight.shape
    width = layer.accumulator_width
    pack = best_packing(layer.weight_limit, layer.input_limit, input_width, frame.dsp)
    pairs = neurons // 2 if pack else 0
    single = neurons - 2 * pairs
    if pairs:
        groups = -(-inputs // (1 << pack.levels))
        yield multiplication(pixels * pairs * inputs, pack.width, input_width)
        yield addition(pixels * pairs * (inputs - groups), pack.width + input_width)
        yield addition(pixels * pairs * 2 * (2 * groups - 1), width)  # to split, and to sum on
    if single:
        yield multiplication(pixels * single * inputs, layer.weight_bits, input_width)
        yield addition(pixels * single * inputs, width)
    if layer.requantisation is not None:
        yield multiplication(pixels * neurons, width, MULTIPLIER_BITS)


def baked_works(frame: Frame, layer: Layer, *, input_signed: bool) -> Iterator[Work]:
    """A layer with baked weights: additions of its graph, of biases, and of the graphs of its scale."""
    inputs = input_ranges(layer, input_signed=input_signed)
    reached = accumulator_ranges(layer, input_signed=input_signed)
    graph = layer_graph(layer, input_signed=input_signed)
    bits = graph.adder_bits(inputs)
    bits += [total.width for total, own in zip(reached, graph.outputs, strict=True) if own is not None]
    scale = layer.requantisation
    for k, total in enumerate(reached if scale is not None else ()):
        held, product = scale_graph(scale, k, total.high)
        bits += product.adder_bits([held])
    for width, count in sorted(Counter(bits).items()):
        yield addition(frame.pixels * count, width)


def normals_works(frame: Frame, layers: tuple[Layer, ...]) -> Iterator[Work]:
    input_width = WIDTH
    for layer in layers:
        yield from layer_works(frame, layer, input_width, input_signed=layer is layers[0])
        if layer.requantisation is not None:
            input_width = layer.requantisation.bits + 1


def gradients_works(frame: Frame, ratio) -> Iterator[Work]:
    """Division: two magnitudes, an addition or subtraction for each bit of a quotient, two roundings."""
    yield addition(2 * frame.pixels * (1 + ratio.width), ratio.normal_width)
    yield addition(2 * frame.pixels, ratio.width)


def source_works(frame: Frame, source) -> Iterator[Work]:
    ahead = STENCILS[source.divergence].ahead
    words = ahead + (ahead + 1)  # of a column in the row buffer: rows of p, and of q
    beats = frame.pixels // frame.lanes
    yield memory(2 * beats, words * frame.lanes * source.gradient_width, frame.width // frame.lanes)
    yield addition(frame.inner * source.terms, source.width)
    offset = signed_width(int(np.abs(source.offset).max()))
    yield memory(frame.inner_beats, frame.lanes * offset, frame.inner_beats)


def rest_works(frame: Frame, depth) -> Iterator[Work]:
    """The sum with, or the difference from, the depth at rest."""
    width = signed_width(int(np.abs(depth.rest).max()))
    yield memory(frame.inner_beats, frame.lanes * width, frame.inner_beats)
    yield addition(frame.inner, depth.width)


def displacement_works(frame: Frame, pipeline: IntegerPipeline) -> Iterator[Work]:
    depth = pipeline.depth
    if depth.mode == "absolute":
        yield from rest_works(frame, depth)
    else:
        yield addition(frame.inner, depth.width)  # the sign
    yield addition(frame.inner, depth.width)  # rounding


def patch_force_works(frame: Frame, force: PatchForce) -> Iterator[Work]:
    axes, words = len(force.kernel), force.size**2
    bits = force.displacement_bits
    if force.size > 1:
        row_words = frame.lanes * (force.size - 1)
        yield memory(2 * frame.inner_beats, row_words * bits, frame.row_beats)
    yield memory(frame.inner_beats, frame.lanes * axes * words * force.kernel_bits, frame.inner_beats)
    yield multiplication(frame.inner * axes * words, bits + (not force.signed), force.kernel_bits)
    yield addition(frame.inner * axes * (words - 1), force.pixel_width)
    yield addition(frame.inner * axes, force.width)


def weighted_force_works(frame: Frame, pipeline: IntegerPipeline) -> Iterator[Work]:
    force = pipeline.force
    axes, rows, columns, terms = force.weight.shape
    values = rows * columns * terms
    yield weight_reads(frame, force, ())
    yield multiplication(values * axes, force.input_width + (not force.input_signed), force.weight_width)
    yield addition(values * axes, force.width)


def weight_reads(frame: Frame, force: WeightedSum, bends: tuple[int, ...]) -> Work:
    """A frame's reads of its weights: each beat the word of its pixels or their squares."""
    _, rows, columns, _ = force.weight.shape
    _, _, bits, words = weight_memory(force, frame.lanes, bends, folded=frame.fold > 1)
    return memory(rows * -(-columns // frame.lanes), bits, words)


def bent_force_works(frame: Frame, pipeline: IntegerPipeline) -> Iterator[Work]:
    """A folded sum takes a product an axis of each pixel and one for each bend; others take one product with
    the slope of the pixel's segment, and additions for the offset."""
    force, bends = pipeline.force, pipeline.bends
    axes, rows, columns, _ = force.weight.shape
    values = rows * columns * axes
    if frame.fold > 1:
        values *= products_of(len(bends))
        width, bends = force.weight_width, ()
    else:
        width = rom_width(force, bends)
        for count, bits in offset_adders(width, bends):
            yield addition(values * count, bits)
    yield weight_reads(frame, force, bends)
    yield multiplication(values, force.input_width, width)
    yield addition(values, force.width)


def darkness_works(frame: Frame, windows: DotWindows) -> Iterator[Work]:
    """The sum of each pixel's channels, and its difference from the threshold."""
    yield addition(frame.pixels * frame.channels, windows.darkness_width)


def bridge_works(frame: Frame, bridge: SlopeBridge, slope_bits: int) -> Iterator[Work]:
    """A window of beats, through which all slopes pass."""
    ahead = SlopeBridgeStream.beats_ahead(bridge.reach, frame.lanes)
    yield register(frame.pixels * (2 * ahead + 1), 2 * slope_bits)


def dots_works(frame: Frame, follower: DotFollower, dots: DotForce) -> Iterator[Work]:
    """Windows' sums down columns and along rows, the rows kept, two divisions a dot, and its weights."""
    windows, count = follower.windows, len(follower.rest)
    rows, columns = windows.shape
    cells, terms = frame.pixels // CELL**2, 2 * windows.half + 1
    words = windows.mass_width + 2 * windows.moment_width
    yield addition(2 * cells * terms, words)
    yield memory(cells, 2 * windows.half * words, frame.width // CELL)
    yield memory(rows * columns + 2 * count, words, rows * columns)
    yield addition(count * 2 * quotient_bits(follower), windows.mass_width)
    axes = len(dots.exponent)
    yield multiplication(count * 2 * axes, dots.weighted.input_width, dots.weighted.weight_width)
    yield addition(count * 2 * axes + axes, dots.weighted.width)


def slip_works(spread: DotSpread, follower: DotFollower) -> Iterator[Work]:
    """Shifts kept and read, four products a dot, and the ratio's products and quotient a bit at a time."""
    count, bounds = len(follower.rest), spread.bounds
    shift, place = follower.width, signed_width(max(spread.largest[:2]))
    kept = KEPT_FRAMES * count
    yield memory(2 * count, 2 * shift + 1, kept)
    yield multiplication(2 * count, shift, shift)
    yield multiplication(2 * count, shift, place)
    yield addition(4 * count, signed_width(bounds["square"]))
    yield addition(4 * count, signed_width(bounds["u"]))
    phases = SpreadRatio.phases_of(spread)
    yield addition(3 * sum(phases) + bounds["spread"].bit_length(), signed_width(bounds["A"] * bounds["C"]))


def interval_works(interval: ForceInterval) -> Iterator[Work]:
    """Measures kept until the force is there, and a product and a sum for each measure and axis."""
    axes, widths = len(interval.base), interval.magnitude_widths
    yield memory(2, sum(widths), FRAMES_IN_FLIGHT)
    for width in widths:
        yield multiplication(axes, width, WEIGHT_BITS)
        yield addition(axes, interval.sum_width)


def with_registers(works: list[Work]) -> list[Work]:
    """And a register for each result."""
    results = [w for w in works if w.kind in ("multiplication", "addition")]
    return works + [register(w.count, w.bits) for w in results]


def works(pipeline: IntegerPipeline) -> dict[str, list[Work]]:
    """What a frame takes, stage by stage; only the stages that the scene wants."""
    frame, scene, solver = Frame(pipeline), pipeline.scene, pipeline.solver
    stages = {"background": background_works(frame)}
    if scene.network.smoothing_px:
        stages["smoothing"] = smoothing_works(frame, scene.network.smoothing_px)
    stages["normals"] = normals_works(frame, pipeline.layers)
    if scene.wants_slopes:
        stages["gradients"] = gradients_works(frame, pipeline.ratio)
    if scene.wants_solver:
        stages["source"] = source_works(frame, pipeline.source)
        stages["row_forward"] = transform_works(frame, solver.row_forward)
        stages |= SOLVERS[scene.poisson.solver].works(frame, solver)
        stages["row_inverse"] = transform_works(frame, solver.row_inverse)
        if "depth" in scene.outputs and pipeline.depth.mode == "difference":
            stages["depth"] = rest_works(frame, pipeline.depth)
        if scene.force_from_displacement:
            stages["displacement"] = displacement_works(frame, pipeline)
    if isinstance(pipeline.force, PatchForce):
        stages["force"] = patch_force_works(frame, pipeline.force)
    elif pipeline.force is not None:
        works_of = bent_force_works if pipeline.bends else weighted_force_works
        stages["force"] = works_of(frame, pipeline)
    if scene.wants_darkness:
        windows = (pipeline.bridge or pipeline.follower).windows
        stages["darkness"] = darkness_works(frame, windows)
    if scene.wants_bridge:
        stages["bridge"] = bridge_works(frame, pipeline.bridge, pipeline.ratio.width)
    if scene.wants_dots:
        stages["dots"] = dots_works(frame, pipeline.follower, pipeline.dot_force)
    if scene.wants_slip:
        stages["slip"] = slip_works(pipeline.spread, pipeline.follower)
    if pipeline.interval is not None:
        stages["interval"] = interval_works(pipeline.interval)
    return {name: with_registers(list(stage)) for name, stage in stages.items()}


def estimate(pipeline: IntegerPipeline) -> dict:
    """The report's keys: µJ of a frame in all, by stage, and by kind of operation."""
    found = works(pipeline)
    everything = [w for stage in found.values() for w in stage]

    def uj(chosen: list[Work]) -> float:
        return sum(w.total_pj for w in chosen) * 1e-6

    kinds = sorted({w.kind for w in everything})
    return {
        "energy_estimate_uj_per_frame": {"value": uj(everything), "origin": ORIGIN},
        "energy_estimate_uj_per_frame_by_stage": {
            "value": {name: uj(stage) for name, stage in found.items()},
            "origin": "estimated: as energy_estimate_uj_per_frame",
        },
        "energy_estimate_uj_per_frame_by_kind": {
            "value": {kind: uj([w for w in everything if w.kind == kind]) for kind in kinds},
            "origin": "estimated: as energy_estimate_uj_per_frame",
        },
    }
