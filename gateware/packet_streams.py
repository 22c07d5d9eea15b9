# amaranth: UnusedElaboratable=no
"""The streams of the top level with hardware.streams "packets": frames in, images with records out."""

from amaranth import Cat, Module, ResetInserter, Signal, Value
from amaranth.lib import wiring

from fastac.gateware.bus.frame_timer import STAMP
from fastac.gateware.bus.record import record_form
from fastac.gateware.bus.registers import RegisterBlock
from fastac.gateware.bus.result_registers import stamp_record
from fastac.gateware.datapath import Datapath
from fastac.gateware.frame_cycles import RESULTS, RESULTS_WORD_BYTES
from fastac.gateware.packet_format import FrameFormat
from fastac.gateware.packets.packet_input import PacketInput, packet_signature
from fastac.gateware.packets.packet_port import PacketPort, aborted_record
from fastac.gateware.packets.record_beats import RecordBeats
from fastac.gateware.packets.record_queue import RecordQueue
from fastac.gateware.raster_outputs import RASTERS, WORD, RasterOutput
from fastac.gateware.stream.frame_end import FrameEnd
from fastac.gateware.stream.queues import BypassQueue


class PacketStreams:
    """What stands between the datapath and its AXI4-Streams of packets, to be put into the top level's
    module.

    outputs : the image outputs; without any there is one stream of records alone, RESULTS
    """

    def __init__(self, path: Datapath, outputs: tuple[RasterOutput, ...]):
        sensor = path.scene.sensor
        self.path, self.outputs = path, outputs
        self.form = record_form(path.wants_interval)
        frame = FrameFormat(sensor.height_px, sensor.width_px, len(sensor.channel_names), path.lanes)
        self.input = PacketInput(frame, pause=path.frame_pause)
        # Only without images, results are held back until there is room for their records.
        self.results = None if outputs else RecordQueue(bits=self.form.bits)

    @property
    def signatures(self) -> dict[str, wiring.Signature]:
        """{name of an output's ports, before their members': its stream, seen from the master}."""
        octets = {output.name: output.octets for output in self.outputs} or {RESULTS: RESULTS_WORD_BYTES}
        return {f"m_axis_{name}": packet_signature(count) for name, count in octets.items()}

    def connect_input(self, m: Module, registers: RegisterBlock) -> None:
        """Frames from `input.axis`. The counters of a packet's beats are outside the soft reset."""
        m.submodules.packet_input = entry = self.input
        wiring.connect(m, entry.o, self.path.axis)
        m.d.comb += [
            entry.enable.eq(registers.enable),
            self.path.enable.eq(entry.o_enable),
            registers.accepted.eq(entry.accepted),
        ]

    def connect_results(self, m: Module, registers: RegisterBlock, found: Value, port) -> None:
        """Records alone to `port`; `found`: a result is taken. A soft reset leaves them whole."""
        m.submodules.results_queue = queue = self.results
        m.submodules.results_beats = beats = RecordBeats(RESULTS_WORD_BYTES, record_octets=self.form.bytes)
        wiring.connect(m, queue.o, beats.i)
        m.d.comb += [
            self.path.tag.ready.eq(1),
            queue.enters.eq(found & ~registers.soft_reset),
            queue.record.eq(registers.record),
            queue.record_valid.eq(registers.record_valid),
            port.tvalid.eq(beats.o.valid),
            port.tdata.eq(beats.o.payload.bytes),
            port.tlast.eq(beats.o.payload.last),
            port.tkeep.eq((1 << RESULTS_WORD_BYTES) - 1),
            beats.o.ready.eq(port.tready),
        ]

    def connect_images(self, m: Module, registers: RegisterBlock, ports: dict) -> None:
        """All image outputs to the ports of their names."""
        path, rooms = self.path, []
        admitted = Signal()  # a frame has left the guard, and each packet's queue has room for its record
        for output in self.outputs:
            queue = self._image(m, registers, output, ports[output.name])
            m.d.comb += queue.enters.eq(admitted)
            if output.complete:
                m.d.comb += [queue.record.eq(registers.record), queue.record_valid.eq(registers.record_valid)]
            else:
                m.d.comb += [queue.record.eq(registers.stamp), queue.record_valid.eq(admitted)]
            rooms.append(queue.room)
        m.d.comb += [
            path.tag.ready.eq(Cat(rooms).all()),
            admitted.eq(path.tag.valid & path.tag.ready),
        ]

    def _image(self, m: Module, registers: RegisterBlock, output: RasterOutput, port) -> RecordQueue:
        """One image output to its port; returns the queue of its records, whose inputs are to be
        connected."""
        name, source, reset = output.name, getattr(self.path, output.name), registers.soft_reset
        raster = PacketPort(
            output.rows,
            output.beats,
            output.octets,
            void_octets=output.void_octets,
            record_octets=self.form.bytes,
            aborted=aborted_record(self.form),
        )
        m.submodules[f"{name}_port"] = raster
        values = RASTERS[name].beat(source.payload, output.lanes)
        words = []
        for k, value in enumerate(values):
            word = Signal(WORD, name=f"{name}_word_{k}")
            m.d.comb += word.eq(value)
            words.append(word)
            if k % output.words == output.words - 1:
                words += [Signal(WORD, name=f"{name}_padding_{k}_{n}") for n in range(output.padding)]
        m.submodules[f"{name}_end"] = ResetInserter(reset)(end := FrameEnd(output.rows * output.beats))
        m.d.comb += end.taken.eq(source.valid & source.ready)
        if RASTERS[name].timed:
            m.d.comb += getattr(registers, f"{name}_done").eq(end.done)
        depth = self.path.packet_queue(name)
        if depth:
            waiting = BypassQueue(8 * output.octets, depth=depth)
            m.submodules[f"{name}_waiting"] = ResetInserter(reset)(waiting)
            m.d.comb += [
                waiting.i.payload.eq(Cat(words)),
                waiting.i.valid.eq(source.valid),
                source.ready.eq(waiting.i.ready),
            ]
            wiring.connect(m, waiting.o, raster.i)
        else:
            m.d.comb += [
                raster.i.payload.eq(Cat(words)),
                raster.i.valid.eq(source.valid),
                source.ready.eq(raster.i.ready),
            ]
        queue = RecordQueue(bits=self.form.bits if output.complete else STAMP.size)
        m.submodules[f"{name}_records"] = ResetInserter(reset)(queue)
        record = queue.o.payload if output.complete else stamp_record(STAMP(queue.o.payload), self.form)
        m.d.comb += [
            raster.record.payload.eq(record),
            raster.record.valid.eq(queue.o.valid),
            queue.o.ready.eq(raster.record.ready),
            raster.cut.eq(reset),
        ]
        wiring.connect(m, raster.port, port)
        return queue
