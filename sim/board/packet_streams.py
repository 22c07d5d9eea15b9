"""Frame packets of a simulated board: models of AXI DMA between the core's streams and memory."""

import cocotb
from cocotb.triggers import Event, First, ReadOnly, RisingEdge

from fastac.sim.dma.axi_dma import AxiDma, S2mm
from fastac.sim.dma.ports import InputPort, OutputPort


class PacketStreams:
    """The DMAs of a design with packets, and the clock by clock traffic between them and the core.

    board : the bench's board; names : its output streams, in the order of the DMAs
    While no beat can move, no clock is looked at, so that waiting costs the simulator's time alone.
    """

    def __init__(self, board, names: list[str]):
        self.board, description = board, board.description
        frame = description["frame"]
        octets = {output["name"]: output["bytes_per_beat"] for output in description["outputs"]}
        self.by_name = {
            name: AxiDma(
                board.memory,
                s2mm_bits=8 * octets.get(name, 4),
                mm2s_bits=8 * frame["bytes_per_beat"] if k == 0 else 0,
            )
            for k, name in enumerate(names)
        }
        self.dmas = list(self.by_name.values())
        self.source = self.dmas[0].mm2s
        self.work = Event()

    def connect(self, dut) -> None:
        self.input = InputPort(dut)
        self.ports = {name: OutputPort(dut, name, dma.s2mm.octets) for name, dma in self.by_name.items()}

    def start(self) -> None:
        cocotb.start_soon(self._run())

    def wake(self) -> None:
        """Something has changed in the DMAs' registers."""
        self.work.set()

    def control(self, value: int) -> int:
        """What is written when the host writes CONTROL."""
        return value

    async def after_soft_reset(self) -> None:
        """The core completes its packets by itself."""

    def levels(self, core: int) -> list[bool]:
        """The interrupt lines, with the core's."""
        return [bool(core), self.source.interrupt, *(dma.s2mm.interrupt for dma in self.dmas)]

    def _rests(self, sink: S2mm, port: OutputPort) -> bool:
        """Whether nothing happens at an output before a beat is offered or the DMA is written to."""
        return sink.ending is None and not sink.rest and not (sink.ready and int(port.valid.value))

    async def _run(self) -> None:
        board, source = self.board, self.source
        outputs = [(dma.s2mm, self.ports[name]) for name, dma in self.by_name.items()]
        levels = self.levels(0)
        while True:
            self.work.clear()
            self.input.offer(source.offer())
            for sink, port in outputs:
                port.open(sink.ready)
            if not source.busy and all(self._rests(*output) for output in outputs):
                # Whatever ends this may do so in a clock edge's own time step, so this clock is only watched.
                await First(self.work.wait(), *(RisingEdge(port.valid) for _, port in outputs))
            await ReadOnly()
            taken, beats = self.input.taken(), [port.beat() for _, port in outputs]
            await RisingEdge(board.dut.clk)
            source.clock(taken)
            for (sink, _), beat in zip(outputs, beats, strict=True):
                # A reset of the DMA in this clock: its beat is lost, as on a board.
                sink.clock(beat if sink.ready else None)
            before, levels = levels, self.levels(0)
            if levels != before:
                board.changed.set()
