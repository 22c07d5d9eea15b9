"""Video streams made into packets, so that a host's driver also runs hardware that no DMA can take frames to.

The bench sends a frame in memory as a video frame, takes each image and adds the frame's record, which it
reads from the registers at the core's interrupt. So the interrupt and its enable bit are the bench's own. On
a board this part does not exist: there the scene says hardware.streams = "packets".
"""

from collections import deque

import cocotb
import numpy as np
from cocotb.triggers import RisingEdge, Timer

from fastac.gateware.bus.record import FORMAT_LOW, RECORD_FORMAT, RecordFlag, record_layout
from fastac.gateware.packet_format import FrameFormat, PacketFormat
from fastac.sim.benches.board_streams import PacketStreams, StreamSink

INTERRUPT_ENABLE = 1 << 3
LEAST_INTERVAL = 600
"""Clocks between the first beats of frames: the time in which a result can be read from the registers."""
QUIET = 200
"""Clocks without a beat after which a soft reset is over: no stream has an open image."""
LAST_FRAME_BAD, SLIP = 1 << 2, 1 << 5
"""Bits of STATUS."""


class VideoStreams(PacketStreams):
    """As `PacketStreams` to the DMAs, as a camera and as readers of video to the core."""

    members = ("tdata", "tvalid", "tlast", "tuser")

    def __init__(self, board, dmas):
        super().__init__(board, dmas)
        description = board.description
        facts = description["frame"]
        channels = len(facts["channels"])
        self.form = FrameFormat(facts["height_px"], facts["width_px"], channels, facts["lanes"])
        self.outputs = {
            o["name"]: PacketFormat(o["name"], o["rows"], o["columns"], o["words_per_pixel"], o["lanes"])
            for o in description["outputs"]
        }
        self.images: dict[str, deque[bytes]] = {name: deque() for name in self.outputs}
        self.waiting: dict[str, deque[bytes]] = {name: deque() for name in dmas}  # whole packets
        self.records: deque[bytes] = deque()
        self.started: deque[int] = deque()  # clock of the first beat of each frame without a result
        self.last_start = -LEAST_INTERVAL
        self.number = 0

    def octets(self, name: str) -> int:
        outputs = {output["name"]: output for output in self.board.description["outputs"]}
        return 4 * outputs[name]["words_per_pixel"] * outputs[name]["lanes"] if name in outputs else 4

    def connect(self, dut) -> None:
        if not self.outputs:
            self.sinks = {}
        super().connect(dut)

    def control(self, value: int) -> int:
        return value | INTERRUPT_ENABLE

    async def run(self) -> None:
        await self.board.write_core("CONTROL", 1 | INTERRUPT_ENABLE)
        cocotb.start_soon(self._serve_interrupts())
        await super().run()

    def frame_beats(self, frame: bytes) -> list[tuple[int, int, int]]:
        """Beats of a frame in memory, its padding left out: a line ends with tlast, tuser marks the start."""
        form = self.form
        pixels = np.frombuffer(frame[: form.bytes], np.uint8).reshape(-1, form.bytes_per_pixel)
        step = form.lanes * form.channels
        octets = np.ascontiguousarray(pixels[:, : form.channels]).tobytes()
        words = [int.from_bytes(octets[at : at + step], "little") for at in range(0, len(octets), step)]
        line = form.width // form.lanes
        return [(word, int(k % line == line - 1), int(k == 0)) for k, word in enumerate(words)]

    def begin(self) -> None:
        if self.beats or self.source.frame_is_cut:
            return
        wait = self.last_start + LEAST_INTERVAL - self.board.cycle
        if wait > 0:
            cocotb.start_soon(self._wake_after(wait))
            return
        super().begin()

    async def _wake_after(self, clocks: int) -> None:
        await Timer(clocks * self.board.period_ps, unit="ps")
        self.work.set()

    def accepted(self) -> None:
        if len(self.beats) == self.form.beats - 1:
            self.last_start = self.board.cycle - 1
            self.started.append(self.last_start)
        super().accepted()

    def may_take(self, sink: StreamSink) -> bool:
        return True

    def beat_taken(self, sink: StreamSink, last: bool) -> None:
        form = self.outputs[sink.name]
        if len(sink.data) == form.rows * form.beats_per_row * sink.octets:
            self.images[sink.name].append(self._padded(form, sink.packet()))
            self._pack()

    @staticmethod
    def _padded(form: PacketFormat, image: bytes) -> bytes:
        """An image's words as they lie in a packet: pixels padded, unused lanes 0."""
        words = np.frombuffer(image, "<u4").reshape(form.rows, -1, form.words)
        padded = np.zeros((*words.shape[:2], form.words_padded), "<u4")
        padded[:, : form.columns, : form.words] = words[:, : form.columns]
        return padded.tobytes()

    def _pack(self) -> None:
        """Packets of every frame that has all its images and its record."""
        while self.records and all(self.images.values()):
            record = self.records.popleft()
            for name, waiting in self.waiting.items():
                image = self.images[name].popleft() if name in self.images else b""
                size = self.outputs[name].packet_bytes if name in self.outputs else len(record)
                waiting.append((image + record).ljust(size, b"\0"))
        self.wake_deliveries()

    def wake_deliveries(self) -> None:
        """Give packets to the DMAs that want some."""
        for name, waiting in self.waiting.items():
            if waiting and self.dmas[name].wants is not None:
                self.dmas[name].deliver(waiting.popleft())

    def wake(self) -> None:
        super().wake()
        self.wake_deliveries()

    async def after_soft_reset(self) -> None:
        """Wait until every open image is complete, and forget what was in flight."""
        quiet = 0
        while quiet < QUIET:
            await RisingEdge(self.board.dut.clk)
            open_images = any(sink.data or int(sink.tvalid.value) for sink in self.sinks.values())
            quiet = 0 if open_images or self.beats else quiet + 1
        for queue in (*self.images.values(), *self.waiting.values(), self.records, self.started):
            queue.clear()
        async with self.board.bus:
            self.number = await self.board.read_core("FRAME_COUNT")
            await self.board.write_core("INTERRUPT_STATUS", 1)

    async def _serve_interrupts(self) -> None:
        board = self.board
        while True:
            if not int(board.dut.interrupt.value):
                await RisingEdge(board.dut.interrupt)
            async with board.bus:
                record = await self._record()
                await board.write_core("INTERRUPT_STATUS", 1)
            if self.started:  # none: a soft reset came first
                record["time"] = self.started.popleft()
                self.records.append(record.tobytes())
                self._pack()

    async def _record(self) -> np.ndarray:
        """The last result's record, from the registers; `time` is left out."""
        read, known = self.board.read_core, self.board.offsets
        record = np.zeros((), record_layout())
        status = await read("STATUS")
        record["validity"] = await read("FRAME_VALIDITY")
        record["errors"] = await read("ERRORS")
        flags = RecordFlag.COMPLETE | RECORD_FORMAT << FORMAT_LOW
        for flag, is_set in (
            (RecordFlag.BAD, status & LAST_FRAME_BAD),
            (RecordFlag.SUSPECT, int(record["validity"])),
            (RecordFlag.SLIP, status & SLIP),
        ):
            flags |= flag if is_set else 0
        record["flags"] = flags
        before = self.number
        self.number = await read("FORCE_SEQUENCE") if "FORCE_SEQUENCE" in known else before + 1
        assert self.number == before + 1, f"results {before} and {self.number}: one was not read in time"
        record["frame"] = self.number
        kind = "FORCE" if "FORCE_SEQUENCE" in known else "DEPTH" if "depth" in self.outputs else "NORMALS"
        record["first_to_result"] = await read(f"LATENCY_FIRST_PIXEL_TO_{kind}")
        if kind == "FORCE":
            record["last_to_result"] = await read("LATENCY_LAST_PIXEL_TO_FORCE")
        for axis in "xyz":
            name = f"FORCE_{axis.upper()}"
            if f"{name}_LOW" in known:
                low, high = await read(f"{name}_LOW"), await read(f"{name}_HIGH")
                record[name.lower()] = np.array(high << 32 | low, np.uint64).astype(np.int64)
        for name in ("SLIP_SPREAD", "SLIP_DOTS"):
            if name in known:
                record[name.lower()] = await read(name)
        return record
