"""What both Poisson solvers share: checking, counting and connecting their chain of stages."""

from collections.abc import Iterable

from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import connect

from fastac.gateware.arithmetic.dsp_slice import DspSlice
from fastac.gateware.dst1_engine import Dst1Engine
from fastac.gateware.stream.queues import SkidBuffer


def frame_interval(height: int, width: int, lanes: int) -> int:
    """Initiation interval in clocks: max(height · width / lanes, N · ceil(N/lanes)), N = width − 2."""
    return max(height * width // lanes, (width - 2) * -(-(width - 2) // lanes))


def transform_slices(
    size: int, lanes: int, input_widths: Iterable[int], *, coefficient_width: int, dsp: DspSlice
) -> int:
    """DSP slices of sine transforms of words of these widths, one after another."""
    return sum(
        Dst1Engine.multipliers_of(
            size, lanes, input_width=width, coefficient_width=coefficient_width, dsp=dsp
        )
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
    """Connect the components named in `solver.stages`, with a skid buffer after the `buffered` ones."""
    output = wiring.flipped(solver.i)
    for name in solver.stages:
        stage = getattr(solver, name)
        m.submodules[name] = stage
        connect(m, output, stage.i)
        output = stage.o
        if name in buffered:
            m.submodules[f"{name}_buffer"] = buffer = SkidBuffer(output.payload.shape())
            connect(m, output, buffer.i)
            output = buffer.o
    connect(m, output, wiring.flipped(solver.o))
    if solver.source.loadable:
        connect(m, wiring.flipped(solver.offset), solver.source.offset)
