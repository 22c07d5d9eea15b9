# amaranth: UnusedElaboratable=no
"""Simulation of each stage's hardware on its worst-case inputs, compared with the integer model."""

from pathlib import Path

import numpy as np

from fastac.gateware.dots.follower import DotFollowerStream, dot_layout
from fastac.gateware.dots.window_stream import DotWindowStream, window_layout
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.fz_stream import PatchForceStream
from fastac.gateware.mlp_mvm import MvmTile
from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.gateware.poisson.depth import DepthOutput, Displacement
from fastac.gateware.poisson.solvers import SOLVERS
from fastac.gateware.poisson.source import PoissonSourceStream
from fastac.gateware.slip.rigid_sums import sums_layout
from fastac.gateware.slip.spread_ratio import SpreadRatio, spread_layout
from fastac.gateware.stream.tables import raster_beats
from fastac.models.integer.depth import Depth
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_spread import DotSpread
from fastac.models.integer.dot_windows import CELL, DotWindows
from fastac.models.integer.features import WIDTH
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.network import GradientRatio, Layer
from fastac.models.integer.source import PoissonSource
from fastac.sim.check_stream import check, pack
from fastac.sim.preloaded import ConstantParameters
from fastac.sim.runner import QUICK
from fastac.studies.robustness.worst_case import BentSum, WorstCase


def _rows(frames: np.ndarray, lanes: int) -> np.ndarray:
    """Frames (…, rows, columns) as beats (beats, lanes) in raster order; a row's unused lanes are 0."""
    return np.concatenate([raster_beats(f, lanes) for f in frames.reshape(-1, *frames.shape[-2:])])


def _layer(case: WorstCase):
    layer = case.stage
    signed = case.inputs.min() < 0
    width = WIDTH if signed else int(layer.input_limit.max()).bit_length()
    tile = MvmTile(layer, input_width=width, input_signed=bool(signed))
    dut = ConstantParameters(tile, tile.core.parameter_image(layer)) if layer.loadable else tile
    return dut, pack(case.inputs, width), pack(case.outputs, layer.accumulator_width), None


def _ratio(case: WorstCase):
    ratio = case.stage
    dut = GradientDivider(ratio, lanes=1)
    return dut, pack(case.inputs, ratio.normal_width), pack(case.outputs, ratio.width), None


def _source(case: WorstCase, lanes: int):
    source = case.stage
    height, width = case.inputs.shape[1:3]
    dut = PoissonSourceStream(source, height=height, width=width, lanes=lanes)
    inputs = pack(case.inputs.reshape(-1, 2 * lanes), source.gradient_width)
    return dut, inputs, case.outputs, source.width


def _frames(case: WorstCase, lanes: int):
    """Stages from frames (…, N, N) to frames: component, width of the inputs, width of the outputs."""
    stage = case.stage
    for solver in SOLVERS.values():
        if type(stage) in solver.engines:
            dut = solver.engines[type(stage)](stage, lanes=lanes)
            return dut, stage.input_width, stage.output_width
    if isinstance(stage, Depth):
        return DepthOutput(stage, lanes=lanes), stage.input_width, stage.width
    depth, quantiser = stage
    return Displacement(depth, quantiser, lanes=lanes), depth.input_width, quantiser.bits


def _force(case: WorstCase, lanes: int):
    force, frames = case.stage, case.inputs
    if isinstance(force, PatchForce):
        dut, bits = PatchForceStream(force, lanes=lanes), force.displacement_bits
        beats = _rows(frames, lanes)
    else:
        bends = ()
        if isinstance(force, BentSum):
            force, bends = force.weighted, force.bends
        lanes = min(lanes, force.weight.shape[2])  # dots come one by one
        # The worst constant is built in, as one that is loaded would stand there.
        dut = WeightedSumStream(force, lanes=lanes, loadable=False, bends=bends)
        bits = force.input_width
        beats = np.concatenate([raster_beats(f, lanes) for f in frames])
    mask = (1 << case.outputs.shape[-1] * force.width) - 1
    return dut, pack(beats.reshape(len(beats), -1), bits), pack(case.outputs, force.width), mask


def _records(layout, rows: np.ndarray) -> list[int]:
    """Rows (…, fields) of the values of a layout's fields, in their order, as payloads."""
    names = list(layout.members)
    rows = rows.reshape(-1, len(names)).tolist()
    return [layout.const(dict(zip(names, row, strict=True))).as_bits() for row in rows]


def _beats(payloads: list[int], size: int, per_beat: int) -> list[int]:
    """Payloads of `size` bits, `per_beat` of them a beat, the first in the LSBs."""
    groups = zip(*per_beat * [iter(payloads)], strict=True)
    return [sum(word << k * size for k, word in enumerate(group)) for group in groups]


def _windows(case: WorstCase, lanes: int):
    dut = DotWindowStream(case.stage, lanes=lanes)
    layout = window_layout(case.stage)
    expected = _beats(_records(layout, case.outputs), layout.size, dut.per_beat)
    return dut, pack(_rows(case.inputs, lanes), case.stage.darkness_width), expected, None


def _shifts(case: WorstCase, lanes: int):
    follower = case.stage
    per_beat, layout = max(1, lanes // CELL), window_layout(follower.windows)
    clocks = CELL * follower.windows.image[1] // lanes
    dut = DotFollowerStream(follower, per_beat=per_beat, row_clocks=clocks)
    inputs = _beats(_records(layout, case.inputs), layout.size, per_beat)
    return dut, inputs, _records(dot_layout(follower), case.outputs), None


def _spread(case: WorstCase, lanes: int):
    dut, layouts = SpreadRatio(case.stage), (sums_layout(case.stage), spread_layout(case.stage))
    inputs, expected = (
        _records(layout, rows) for layout, rows in zip(layouts, (case.inputs, case.outputs), strict=True)
    )
    return dut, inputs, expected, None


DOTS = {DotWindows: _windows, DotFollower: _shifts, DotSpread: _spread}
"""Stages of the dots."""


def compare(case: WorstCase, folder: Path, *, lanes: int, stalls: tuple[float, ...] = (0,)) -> int:
    """Simulate the stage's hardware on the case's inputs; returns how many beats were compared.

    Raises where a beat differs from the integer model (see `sim.check_stream.check`). The bench's log is
    written into `folder`.
    """
    stage = case.stage
    if isinstance(stage, Layer):
        dut, inputs, expected, mask = _layer(case)
    elif isinstance(stage, GradientRatio):
        dut, inputs, expected, mask = _ratio(case)
    elif isinstance(stage, PatchForce | WeightedSum | BentSum):
        dut, inputs, expected, mask = _force(case, lanes)
    elif type(stage) in DOTS:
        dut, inputs, expected, mask = DOTS[type(stage)](case, lanes)
    else:
        if isinstance(stage, PoissonSource):
            dut, inputs, outputs, width = _source(case, lanes)
        else:
            dut, input_width, width = _frames(case, lanes)
            # Some stages of a solver run from the last row to the first.
            order = slice(None, None, 1 if getattr(stage, "downwards", True) else -1)
            inputs = pack(_rows(case.inputs[:, order], lanes), input_width)
            outputs = case.outputs[:, order]
        expected = pack(_rows(outputs, lanes), width)
        mask = pack(_rows(np.full_like(outputs, -1), lanes), width)
    name = case.name.replace(" ", "_")
    check(
        dut,
        name,
        folder / name,
        inputs=inputs,
        expected=expected,
        mask=mask,
        stalls=stalls,
        build_args=QUICK,
        log_file=folder / f"{name}.log",
    )
    return len(expected)
