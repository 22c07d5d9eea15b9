"""Video streams made into packets, so that a host's driver also runs hardware that no DMA can take frames to.

The bench sends a frame in memory as a video frame, takes each image and adds the frame's record, which it
reads from the registers at the core's interrupt. So the interrupt and its enable bit are the bench's own. On
a board this part does not exist: there the scene says hardware.streams = "packets".
"""

from collections import deque

import cocotb
import numpy as np
from cocotb.triggers import Event, First, ReadOnly, RisingEdge, Timer

from fastac.gateware.bus.record import FORMAT_LOW, RecordFlag, record_form
from fastac.gateware.packet_format import WORD_BYTES, FrameFormat, PacketFormat
from fastac.sim.dma.packet_dma import PacketDma

ENABLE, INTERRUPT_ENABLE = 1 << 0, 1 << 3
LEAST_INTERVAL = 600
"""Clocks between the first beats of frames: the time in which a result can be read from the registers."""
QUIET = 200
"""Clocks without a beat after which a soft reset is over: no stream has an open image."""
LAST_FRAME_BAD, SLIP = 1 << 2, 1 << 5
"""Bits of STATUS."""


class _Sink:
    """One output stream, always ready: its beats are collected until an image is whole."""

    def __init__(self, dut, name: str, form: PacketFormat):
        self.name, self.form, self.data = name, form, bytearray()
        self.octets = WORD_BYTES * form.words * form.lanes
        self.tvalid, self.tdata = (getattr(dut, f"m_axis_{name}_{member}") for member in ("tvalid", "tdata"))
        getattr(dut, f"m_axis_{name}_tready").value = 1

    def sample(self) -> None:
        """In the read-only phase of a clock."""
        if int(self.tvalid.value):
            self.data += int(self.tdata.value).to_bytes(self.octets, "little")

    def image(self) -> bytes | None:
        """The image, its pixels padded as in a packet and its unused lanes 0, once it is whole."""
        form = self.form
        if len(self.data) < form.rows * form.beats_per_row * self.octets:
            return None
        words = np.frombuffer(bytes(self.data), "<u4").reshape(form.rows, -1, form.words)
        self.data.clear()
        padded = np.zeros((*words.shape[:2], form.words_padded), "<u4")
        padded[:, : form.columns, : form.words] = words[:, : form.columns]
        return padded.tobytes()


class VideoStreams:
    """To the DMAs' host as `PacketStreams`, to the core as a camera and as readers of video.

    board : the bench's board; names : its output streams, or "results" without an image
    """

    def __init__(self, board, names: list[str]):
        self.board, description = board, board.description
        facts = description["frame"]
        channels = len(facts["channels"])
        self.form = FrameFormat(facts["height_px"], facts["width_px"], channels, facts["lanes"])
        self.outputs = {
            o["name"]: PacketFormat(
                *(o[key] for key in ("name", "rows", "columns", "words_per_pixel", "lanes")),
                record_form("record_bytes" in o).bytes,
            )
            for o in description["outputs"]
        }
        self.by_name = {name: PacketDma(board.memory, board.changed.set) for name in names}
        self.dmas = list(self.by_name.values())
        self.source = self.dmas[0]
        self.work = Event()
        self.beats: deque[tuple[int, int, int]] = deque()  # (tdata, tlast, tuser) of the frame being sent
        self.images: dict[str, deque[bytes]] = {name: deque() for name in self.outputs}
        self.packets: dict[str, deque[bytes]] = {name: deque() for name in names}
        self.records: deque[bytes] = deque()
        self.started: deque[int] = deque()  # clock of the first beat of each frame without a result
        self.last_start = -LEAST_INTERVAL
        self.number = 0
        self.enabled = True

    def connect(self, dut) -> None:
        self.inputs = [getattr(dut, f"s_axis_{member}") for member in ("tdata", "tlast", "tuser", "tvalid")]
        for signal in self.inputs:
            signal.value = 0
        self.sinks = [_Sink(dut, name, form) for name, form in self.outputs.items()]

    def start(self) -> None:
        cocotb.start_soon(self._run())

    def levels(self, core: int) -> list[bool]:
        """The interrupt lines, with the core's."""
        return [bool(core), self.source.mm2s.interrupt, *(dma.s2mm.interrupt for dma in self.dmas)]

    def control(self, value: int) -> int:
        self.enabled = bool(value & ENABLE)
        return value | INTERRUPT_ENABLE

    def _frame_beats(self, frame: bytes) -> list[tuple[int, int, int]]:
        """Beats of a frame in memory, its padding left out: a line ends with tlast, tuser marks the start."""
        form = self.form
        pixels = np.frombuffer(frame[: form.bytes], np.uint8).reshape(-1, form.bytes_per_pixel)
        step = form.lanes * form.channels
        octets = np.ascontiguousarray(pixels[:, : form.channels]).tobytes()
        words = [int.from_bytes(octets[at : at + step], "little") for at in range(0, len(octets), step)]
        line = form.width // form.lanes
        return [(word, int(k % line == line - 1), int(k == 0)) for k, word in enumerate(words)]

    def _begin(self) -> None:
        """Take the next frame from memory, if one waits and its time has come."""
        if self.beats or self.source.frame_is_cut:
            return
        wait = self.last_start + LEAST_INTERVAL - self.board.cycle
        if wait > 0:
            cocotb.start_soon(self._wake_after(wait))
        elif (frame := self.source.frame()) is not None:
            self.beats.extend(self._frame_beats(frame))

    async def _wake_after(self, clocks: int) -> None:
        await Timer(clocks * self.board.period_ps, unit="ps")
        self.work.set()

    async def _run(self) -> None:
        board = self.board
        await board.write_core("CONTROL", 1 | INTERRUPT_ENABLE)
        cocotb.start_soon(self._serve_interrupts())
        *members, tvalid = self.inputs
        clock, ready, shown = board.dut.clk, board.dut.s_axis_tready, None
        while True:
            self.work.clear()
            self._begin()
            offer = self.beats[0] if self.beats else None
            if offer is not shown:
                tvalid.value = int(offer is not None)
                for signal, value in zip(members, offer or (), strict=False):
                    signal.value = value
                shown = offer
            if offer is None and not any(int(sink.tvalid.value) for sink in self.sinks):
                # Whatever ends this may do so in a clock edge's own time step, so this clock is only watched.
                await First(self.work.wait(), *(RisingEdge(sink.tvalid) for sink in self.sinks))
            await ReadOnly()
            taken = offer is not None and int(ready.value)
            for sink in self.sinks:
                sink.sample()
            await RisingEdge(clock)
            if taken and self.beats:  # a reset of the DMA may have taken the rest away
                self._accepted()
            for sink in self.sinks:
                if (image := sink.image()) is not None:
                    self.images[sink.name].append(image)
                    self._pack()

    def _accepted(self) -> None:
        """A beat of the frame was accepted."""
        if len(self.beats) == self.form.beats:
            self.last_start = self.board.cycle - 1
            if self.enabled:  # else the core drops it
                self.started.append(self.last_start)
        self.beats.popleft()
        if not self.beats:
            self.source.sent()

    def _pack(self) -> None:
        """Packets of every frame that has all its images and its record."""
        while self.records and all(self.images.values()):
            record = self.records.popleft()
            for name, packets in self.packets.items():
                image = self.images[name].popleft() if name in self.images else b""
                size = self.outputs[name].packet_bytes if name in self.outputs else len(record)
                packets.append((image + record).ljust(size, b"\0"))
        self._deliver()

    def _deliver(self) -> None:
        """Give packets to the DMAs that want some."""
        for name, packets in self.packets.items():
            if packets and self.by_name[name].wants is not None:
                self.by_name[name].deliver(packets.popleft())

    def wake(self) -> None:
        """Something has changed in the DMAs' registers."""
        if self.source.frame_is_cut:
            self.beats.clear()
        self._deliver()
        self.work.set()

    async def after_soft_reset(self) -> None:
        """Wait until every open image is complete, and forget what was in flight."""
        quiet = 0
        while quiet < QUIET:
            await RisingEdge(self.board.dut.clk)
            open_images = any(sink.data or int(sink.tvalid.value) for sink in self.sinks)
            quiet = 0 if open_images or self.beats else quiet + 1
        for queue in (*self.images.values(), *self.packets.values(), self.records, self.started):
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
        form = record_form("HALF_WIDTH_SEQUENCE" in known)
        record = np.zeros((), form.layout)
        status = await read("STATUS")
        record["validity"] = await read("FRAME_VALIDITY")
        record["errors"] = await read("ERRORS")
        flags = RecordFlag.COMPLETE | form.number << FORMAT_LOW
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
            name = f"HALF_WIDTH_{axis.upper()}"
            if f"{name}_LOW" in known:
                low, high = await read(f"{name}_LOW"), await read(f"{name}_HIGH")
                record[name.lower()] = high << 32 | low
        for name in ("SLIP_SPREAD", "SLIP_DOTS"):
            if name in known:
                record[name.lower()] = await read(name)
        return record
