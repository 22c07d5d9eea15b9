# amaranth: UnusedElaboratable=no
"""What both Poisson solvers share: checking, counting and connecting their chain of stages."""

from collections.abc import Iterable

from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import connect

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.dst1_engine import Dst1Engine
from fastac.gateware.poisson.folded_transform import FoldedDst1
from fastac.gateware.stream.handshake import check_fold, pace
from fastac.gateware.stream.queues import SkidBuffer
from fastac.models.integer.sine_transform import SineTransform


def frame_interval(height: int, width: int, lanes: int, fold: int = 1) -> int:
    """Initiation interval in clocks: fold · max(height · width / lanes, N · ceil(N/lanes)), N = width − 2."""
    return fold * max(height * width // lanes, (width - 2) * -(-(width - 2) // lanes))


def sine_transform(
    transform: SineTransform, *, lanes: int, fold: int = 1, dsp: DspSlice = DSP48E2
) -> Dst1Engine | FoldedDst1:
    """The component for a sine transform of the rows, whose beats come every `fold` clocks."""
    check_fold(fold, lanes)
    if fold > 1:
        return FoldedDst1(transform, fold=fold, dsp=dsp)
    return Dst1Engine(transform, lanes=lanes, dsp=dsp)


def transform_delay(size: int, lanes: int, fold: int = 1) -> int:
    """Clocks from a row's last beat before a sine transform to its last beat behind it."""
    latency = FoldedDst1.latency_of(size, fold) if fold > 1 else Dst1Engine.latency_of(size)
    return latency + (-(-size // lanes) - 1) * fold


def transform_slices(
    size: int,
    lanes: int,
    input_widths: Iterable[int],
    *,
    fold: int = 1,
    coefficient_width: int,
    dsp: DspSlice,
) -> int:
    """DSP slices of sine transforms of words of these widths, one after another."""
    kind, share = (FoldedDst1, fold) if fold > 1 else (Dst1Engine, lanes)
    return sum(
        kind.multipliers_of(size, share, input_width=width, coefficient_width=coefficient_width, dsp=dsp)
        for width in input_widths
    )


def check_stages(stages: dict, given: int, height: int, width: int) -> None:
    """Raise ValueError unless each of `stages` has size N = width − 2 and its predecessor's output width.

    given : output width in bits of the predecessor of the first stage
    """
    if height != width:
        raise ValueError(f"height {height}: expected width = {width}")
    for name, stage in stages.items():
        if stage.size != width - 2:
            raise ValueError(f"{name} of size {stage.size}: expected width - 2 = {width - 2}")
        if stage.input_width != given:
            raise ValueError(f"{name}.input_width {stage.input_width}: expected {given}")
        given = stage.output_width


def connect_stages(m: Module, solver, buffered: tuple[str, ...]) -> None:
    """Connect the components named in `solver.stages`, with a skid buffer after the `buffered` ones.

    A folded solver takes a beat at most every `solver.fold` clocks: one that comes earlier waits.
    """
    output = wiring.flipped(solver.i)
    for name in solver.stages:
        stage = getattr(solver, name)
        m.submodules[name] = stage
        if solver.fold > 1 and stage is solver.source:
            due = pace(m, solver.i.valid & solver.i.ready, solver.fold)
            m.d.comb += [
                stage.i.payload.eq(solver.i.payload),
                stage.i.valid.eq(solver.i.valid & due),
                solver.i.ready.eq(stage.i.ready & due),
            ]
        else:
            connect(m, output, stage.i)
        output = stage.o
        if name in buffered:
            m.submodules[f"{name}_buffer"] = buffer = SkidBuffer(output.payload.shape())
            connect(m, output, buffer.i)
            output = buffer.o
    connect(m, output, wiring.flipped(solver.o))
    if solver.source.loadable:
        connect(m, wiring.flipped(solver.offset), solver.source.offset)
