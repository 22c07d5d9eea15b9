"""What both solvers need to connect their stages in a row."""

from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import connect

from fastac.gateware.stream.queues import SkidBuffer


def frame_interval(height: int, width: int, lanes: int) -> int:
    """Clocks between frames of slopes, of which the solution needs the inner ones."""
    return max(height * width // lanes, (width - 2) * -(-(width - 2) // lanes))


def check_stages(stages: dict, given: int, height: int, width: int) -> None:
    """Raise ValueError unless `stages`, by name and in order, pass words of `given` bits of N × N on."""
    if height != width:
        raise ValueError(f"height {height}: expected width = {width}")
    for name, stage in stages.items():
        if stage.size != width - 2:
            raise ValueError(f"{name} of size {stage.size}: expected width - 2 = {width - 2}")
        if stage.input_width != given:
            raise ValueError(f"{name}.input_width {stage.input_width}: expected {given}")
        given = stage.output_width


def connect_stages(m: Module, solver, buffered: tuple[str, ...]) -> None:
    """Connect the components that `solver.stages` names in a row, a buffer behind the `buffered` ones."""
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
