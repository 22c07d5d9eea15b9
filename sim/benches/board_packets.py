"""Frame packets of a simulated board: models of AXI DMA between the core's streams and memory."""

import cocotb
from cocotb.triggers import Event, First, ReadOnly, RisingEdge

from fastac.sim.dma.axi_dma import AxiDma, Beat, S2mm

MEMBERS = ("tvalid", "tready", "tdata", "tkeep", "tlast")


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
        for name in ("tvalid", "tdata", "tlast"):
            getattr(dut, f"s_axis_{name}").value = 0
        self.ports = {
            name: [getattr(dut, f"m_axis_{name}_{member}") for member in MEMBERS] for name in self.by_name
        }
        for ports in self.ports.values():
            ports[1].value = 0

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

    def _rests(self, sink: S2mm, valid) -> bool:
        """Whether nothing happens at an output before a beat is offered or the DMA is written to."""
        return sink.ending is None and not sink.rest and not (sink.ready and int(valid.value))

    async def _run(self) -> None:
        dut, board, source = self.board.dut, self.board, self.source
        sinks = {name: dma.s2mm for name, dma in self.by_name.items()}
        shown, opened = None, dict.fromkeys(sinks, False)
        levels = self.levels(0)
        while True:
            self.work.clear()
            offer = source.offer()
            if (offer is None) != (shown is None):
                dut.s_axis_tvalid.value = int(offer is not None)
            if offer is not None and offer is not shown:
                dut.s_axis_tdata.value = int.from_bytes(offer.octets, "little")
                dut.s_axis_tkeep.value = offer.keep
                dut.s_axis_tlast.value = int(offer.last)
            shown = offer
            for name, sink in sinks.items():
                if sink.ready != opened[name]:
                    opened[name] = sink.ready
                    self.ports[name][1].value = int(opened[name])
            if not source.busy and all(self._rests(s, self.ports[n][0]) for n, s in sinks.items()):
                # Whatever ends this may do so in a clock edge's own time step, so this clock is only watched.
                await First(self.work.wait(), *(RisingEdge(ports[0]) for ports in self.ports.values()))
            await ReadOnly()
            taken = offer is not None and bool(int(dut.s_axis_tready.value))
            beats = {name: self._beat(name) if opened[name] else None for name in sinks}
            await RisingEdge(dut.clk)
            source.clock(taken)
            for name, sink in sinks.items():
                # A reset of the DMA in this clock: its beat is lost, as on a board.
                sink.clock(beats[name] if sink.ready else None)
            before, levels = levels, self.levels(0)
            if levels != before:
                board.changed.set()

    def _beat(self, name: str) -> Beat | None:
        """In the read-only phase of a clock: the beat that is valid, if any."""
        valid, _, data, keep, last = self.ports[name]
        if not int(valid.value):
            return None
        octets = self.by_name[name].s2mm.octets
        return Beat(int(data.value).to_bytes(octets, "little"), int(keep.value), bool(int(last.value)))
