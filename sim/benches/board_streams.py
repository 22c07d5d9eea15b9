"""The streams of a simulated board: frames from memory to the core, the core's packets to memory."""

from collections import deque

from cocotb.triggers import Event, First, ReadOnly, RisingEdge

from fastac.sim.benches.simple_dma import SimpleDma


class StreamSink:
    """One output stream: beats are taken while `open` says so, and collected until a packet is whole."""

    def __init__(self, name: str, octets: int):
        self.name, self.octets, self.data = name, octets, bytearray()
        self.is_open = False

    def connect(self, dut) -> None:
        for member in ("tvalid", "tready", "tdata", "tlast"):
            setattr(self, member, getattr(dut, f"m_axis_{self.name}_{member}"))
        self.tready.value = 0

    def open(self, is_open: bool) -> None:
        if is_open != self.is_open:
            self.tready.value = int(is_open)
            self.is_open = is_open

    def take(self) -> bool | None:
        """In the read-only phase of a clock: None without a beat, else whether it is a packet's last one."""
        if not self.is_open or not int(self.tvalid.value):
            return None
        self.data += int(self.tdata.value).to_bytes(self.octets, "little")
        return bool(int(self.tlast.value))

    def packet(self) -> bytes:
        found = bytes(self.data)
        self.data.clear()
        return found


class PacketStreams:
    """Frame packets: a frame is one packet on `s_axis`, and each packet of an output is one transfer."""

    def __init__(self, board, dmas: dict[str, SimpleDma]):
        self.board, self.dmas, self.source = board, dmas, next(iter(dmas.values()))
        self.work = Event()
        self.beats: deque[tuple[int, int, int]] = deque()  # (tdata, tlast, tuser) of the frame being sent
        self.sinks = {name: StreamSink(name, self.octets(name)) for name in dmas}

    def octets(self, name: str) -> int:
        """Bytes of a beat of an output."""
        outputs = {output["name"]: output for output in self.board.description["outputs"]}
        return outputs[name]["bytes_per_beat"] if name in outputs else 4

    def connect(self, dut) -> None:
        self.inputs = {m: getattr(dut, f"s_axis_{m}") for m in self.members}
        self.tready = dut.s_axis_tready
        for signal in self.inputs.values():
            signal.value = 0
        if "tkeep" in self.inputs:
            self.inputs["tkeep"].value = (1 << len(self.inputs["tkeep"])) - 1
        for sink in self.sinks.values():
            sink.connect(dut)

    members = ("tdata", "tvalid", "tlast", "tkeep")
    """Of `s_axis`, that the DMA drives."""

    def wake(self) -> None:
        """Something has changed in the DMAs' registers."""
        if self.source.frame_is_cut:
            self.beats.clear()
        for name, dma in self.dmas.items():
            if dma.was_reset:
                dma.was_reset = False
                if name in self.sinks:
                    self.sinks[name].data.clear()
        self.work.set()

    def control(self, value: int) -> int:
        """What is written when the host writes CONTROL."""
        return value

    async def after_soft_reset(self) -> None:
        """The core completes its packets by itself."""

    def frame_beats(self, frame: bytes) -> list[tuple[int, int, int]]:
        """Beats of a frame in memory: (tdata, tlast, tuser)."""
        step = self.board.description["frame"]["bytes_per_beat"]
        words = [int.from_bytes(frame[at : at + step], "little") for at in range(0, len(frame), step)]
        return [(word, int(k == len(words) - 1), 0) for k, word in enumerate(words)]

    def begin(self) -> None:
        """Take the next frame from the DMA, if one waits."""
        if not self.beats and (frame := self.source.frame()) is not None:
            self.beats.extend(self.frame_beats(frame))

    def accepted(self) -> None:
        """A beat of the frame was accepted."""
        if not self.beats:
            self.source.sent()

    def may_take(self, sink: StreamSink) -> bool:
        return self.dmas[sink.name].wants is not None

    def beat_taken(self, sink: StreamSink, last: bool) -> None:
        """An output's beat has come."""
        if last:
            self.dmas[sink.name].deliver(sink.packet())

    async def run(self) -> None:
        """Move beats, clock by clock while there are any."""
        clock, sinks = self.board.dut.clk, list(self.sinks.values())
        offered: tuple[int, int, int] | None = None
        while True:
            self.work.clear()
            self.begin()
            offer = self.beats[0] if self.beats else None
            if offer is not offered:
                self.offer(offer)
                offered = offer
            for sink in sinks:
                sink.open(self.may_take(sink))
            if offer is None and not any(int(sink.tvalid.value) and sink.is_open for sink in sinks):
                # Whatever wakes it may do so in a clock edge's own time step, so this clock is only watched.
                await First(self.work.wait(), *(RisingEdge(sink.tvalid) for sink in sinks))
            await ReadOnly()
            accepted = offer is not None and int(self.tready.value)
            taken = [(sink, sink.take()) for sink in sinks]
            await RisingEdge(clock)
            if accepted and self.beats:  # a reset of the DMA may have taken the rest away
                self.beats.popleft()
                self.accepted()
            for sink, last in taken:
                if last is not None:
                    self.beat_taken(sink, last)

    def offer(self, beat: tuple[int, int, int] | None) -> None:
        """Drive `s_axis`."""
        self.inputs["tvalid"].value = int(beat is not None)
        if beat is not None:
            self.inputs["tdata"].value, self.inputs["tlast"].value = beat[:2]
            if "tuser" in self.inputs:
                self.inputs["tuser"].value = beat[2]
