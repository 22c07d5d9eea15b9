# amaranth: UnusedElaboratable=no
"""Top level for the Zynq's programmable logic: AXI4-Streams in and out, AXI4-Lite registers, interrupt."""

from amaranth import Cat, Module, ResetInserter, Signal
from amaranth.lib import fifo, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.axi_lite import axi_lite_signature
from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.register_map import ADDRESS_WIDTH, AXES
from fastac.gateware.bus.registers import RegisterBlock
from fastac.gateware.calibration import image_layout, make_loader
from fastac.gateware.datapath import Datapath
from fastac.gateware.frame_cycles import RESULTS
from fastac.gateware.packet_streams import PacketStreams
from fastac.gateware.raster_outputs import RASTERS, WORD, RasterOutput, raster_outputs
from fastac.gateware.stream.frame_guard import EVENTS, FRAME_FAULTS, FRAMES_IN_FLIGHT
from fastac.gateware.stream.raster_port import RasterPort, raster_members
from fastac.models.integer.bundle import Bundle

VERSION = 7
"""Version of the hardware and of its register map, in the register VERSION."""
FRAME_TIMEOUT_S = 0.1
"""Initial value of FRAME_TIMEOUT: three frames of a camera with 30 frames a second."""
WORD_LIMIT = (1 << 32) - 1
"""The largest value of a register."""
RESULT = {"force": "result_valid", "depth": "depth_done", "normals": "normals_done"}
"""Input of RegisterBlock that pulses with a frame's result, for each kind of result."""


def flattened_ports(prefix: str, signature: wiring.Signature, direction) -> dict[str, wiring.Member]:
    """A bus as single ports `prefix`_member, the names by which Vivado recognises AXI interfaces."""
    members = signature.members if direction == Out else signature.flip().members
    return {f"{prefix}_{name}": member for name, member in members.items()}


class TopZynq(wiring.Component):
    """A bundle as an IP core with AXI interfaces.

    Members
    -------
    s_axis_* : AXI4-Stream slave for the camera's frames. tdata: `lanes` pixels of 8-bit channels in the
        scene's order, lane 0 and channel 0 in the least significant bits; tuser: start of frame; tlast: end
        of line.
    s_axil_* : AXI4-Lite slave, the registers of gateware/bus/register_map.py
    m_axis_depth_* : AXI4-Stream master of depth maps: `lanes` signed 32-bit words per beat, N rows of N
        values, N = width − 2. tkeep: bytes of the lanes that hold a value; tlast: end of row; tuser[0]: start
        of frame; tuser[1]: the frame is bad; tuser[9:2]: the row, 0 to N − 1; tuser[10]: the frame is
        suspect, that is, FRAME_VALIDITY has a bit other than `displacement`, which does not concern the
        depth. The tridiagonal solver sends the last row first. Only if the scene has this output.
    m_axis_force_map_* : the same for the raw responses of the pixels: one signed 32-bit word per axis and
        pixel, all axes of a pixel adjacent. Only if the scene has this output.
    m_axis_normals_* : AXI4-Stream master of normals: three signed 32-bit words (x, y, z), not normalised, per
        pixel, height × width pixels, without tkeep; tuser: start of frame; tlast: end of row. Only if the
        scene has this output.
    interrupt : level interrupt, high while an enabled interrupt is pending

    The force and slip are read from the registers; whether its frame was bad or suspect is in STATUS and
    FRAME_VALIDITY. If the network is loadable, the register CALIBRATION loads another calibration between
    frames (gateware/calibration.py); resets do not undo that. A soft reset aborts the frames in flight; an
    output stream inside a frame completes it with zeros marked as bad (gateware/stream/raster_port.py), and
    its next beat is a start of frame.
    """

    def __init__(self, bundle: Bundle):
        pipeline, scene = bundle.pipeline, bundle.scene
        self.bundle = bundle
        self.datapath = Datapath(pipeline)
        self.lanes = self.datapath.lanes
        path = self.datapath
        self.outputs = raster_outputs(pipeline, rows_reversed=path.rows_reversed)
        self.packets = PacketStreams(path, self.outputs) if scene.hardware.streams == "packets" else None
        layout = image_layout(path) if path.loadable else None
        self.identity = Identity(
            bundle_hash=bundle.hash_word,
            version=VERSION,
            height=scene.sensor.height_px,
            width=scene.sensor.width_px,
            channels=len(scene.sensor.channel_names),
            lanes=self.lanes,
            axes="".join(AXES[axis] for axis in scene.force_axes),
            force_width=pipeline.force_width if path.wants_force else 64,
            background_capture=True,
            **{"depth": False} | {output.name: True for output in self.outputs},
            rows_reversed=path.rows_reversed,
            calibration_words=layout.words if layout else 0,
            calibration_layout=layout.identifier if layout else 0,
            half_width=path.wants_interval,
            half_width_bits=path.interval_stream.half_width if path.wants_interval else 64,
            slip=scene.wants_slip,
            slip_limit=min(pipeline.slip_limit, WORD_LIMIT) if scene.wants_slip else 0,
            frame_timeout=round(FRAME_TIMEOUT_S * scene.hardware.clock_mhz * 1e6),
            packets=self.packets is not None,
            bus_errors=scene.hardware.bus_errors,
        )
        frames, self.sent = self.datapath.axis.signature.flip(), {}
        if self.packets:
            frames, self.sent = self.packets.input.axis.signature.flip(), self.packets.signatures
        else:
            for output in self.outputs:
                port = wiring.Signature(raster_members(output.octets, tagged=output.tagged))
                self.sent[f"m_axis_{output.name}"] = port
        members = {
            **flattened_ports("s_axis", frames, In),
            **flattened_ports("s_axil", axi_lite_signature(ADDRESS_WIDTH), In),
            "interrupt": Out(1),
        }
        for prefix, signature in self.sent.items():
            members |= flattened_ports(prefix, signature, Out)
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        m.submodules.registers = registers = RegisterBlock(self.identity)
        path = self.datapath
        m.submodules.datapath = ResetInserter(registers.soft_reset)(path)

        if self.packets:
            self.packets.connect_input(m, registers)
        else:
            m.d.comb += [path.enable.eq(registers.enable), registers.accepted.eq(path.accepted)]
        frames = self.packets.input.axis if self.packets else path.axis
        for prefix, bus in (("s_axis", frames), ("s_axil", registers.axil)):
            for name, member in bus.signature.members.items():
                port, signal = getattr(self, f"{prefix}_{name}"), getattr(bus, name)
                m.d.comb += signal.eq(port) if member.flow == In else port.eq(signal)
        m.d.comb += [
            path.timeout.eq(registers.timeout_clocks),
            path.capture.eq(registers.capture_background),
            self.interrupt.eq(registers.interrupt),
            registers.gradient_saturated.eq(path.gradient_saturated),
            registers.displacement_saturated.eq(path.displacement_saturated),
            Cat(getattr(registers, n) for n in (*EVENTS[1:], *FRAME_FAULTS)).eq(
                Cat(getattr(path, n) for n in (*EVENTS[1:], *FRAME_FAULTS))
            ),
        ]
        if path.loadable:
            m.submodules.calibration = calibration = make_loader(path, self.bundle.hash_word)
            wiring.connect(m, registers.calibration, calibration.host)
            # `write` holds frames back too, so that none can start in the clock of an image's first word.
            m.d.comb += path.hold.eq(calibration.host.loading | calibration.host.write)
            m.d.comb += [getattr(path, n).eq(getattr(calibration, n)) for n in path.loadable_registers]
            for name in path.loadable_tables:
                wiring.connect(m, getattr(calibration, name), getattr(path, name))
        m.d.comb += registers.background_taken.eq(path.captured)

        if path.wants_force:
            found = path.force.valid
            if path.scene.force_beside_depth:
                # The solver may let the last slopes, and so their flag, wait when the force has them.
                found &= path.verdict.valid
            if self.identity.slip:
                found &= path.slip.valid
                m.d.comb += [
                    path.slip.ready.eq(found),
                    registers.spread.eq(path.slip.payload.spread),
                    registers.touching.eq(path.slip.payload.dots),
                ]
            if self.packets and self.packets.results:
                found &= self.packets.results.room
            m.d.comb += [
                path.force.ready.eq(found),
                registers.result_valid.eq(found),
                registers.force.eq(path.force.payload),
            ]
        if path.wants_interval:
            m.d.comb += [
                path.half_widths.ready.eq(1),
                registers.half_widths_valid.eq(path.half_widths.valid),
                registers.half_widths.eq(path.half_widths.payload),
            ]
        m.d.comb += [
            registers.validity.eq(path.verdict.payload),
            path.verdict.ready.eq(getattr(registers, RESULT[self.identity.result])),
        ]
        if self.packets:
            self._packets(m, registers)
        else:
            self._video(m, registers)
        return m

    def _packets(self, m, registers) -> None:
        """Connect the packet streams to their ports."""
        ports = {}
        for prefix, signature in self.sent.items():
            bus = signature.flip().create(path=(prefix,))
            for name, member in signature.members.items():
                port, signal = getattr(self, f"{prefix}_{name}"), getattr(bus, name)
                m.d.comb += port.eq(signal) if member.flow == Out else signal.eq(port)
            ports[prefix.removeprefix("m_axis_")] = bus
        if self.outputs:
            self.packets.connect_images(m, registers, ports)
        else:
            self.packets.connect_results(m, registers, registers.result_valid, ports[RESULTS])

    def _video(self, m, registers) -> None:
        """Connect the image outputs, a packet a row, to their ports."""
        path, tags = self.datapath, []
        for output in self.outputs:
            done, tag = self._raster(m, output, registers.soft_reset)
            if output.tagged:
                tags.append(tag)
            if RASTERS[output.name].timed:
                m.d.comb += getattr(registers, f"{output.name}_done").eq(done)
        # A frame's tag goes to all tagged streams in the same clock.
        m.d.comb += path.tag.ready.eq(Cat(tag.w_rdy for tag in tags).all())
        for tag in tags:
            m.d.comb += [
                tag.w_data.eq(path.tag.payload),
                tag.w_en.eq(path.tag.valid & path.tag.ready),
            ]

    def _raster(self, m, output: RasterOutput, reset) -> tuple[Signal, fifo.SyncFIFO | None]:
        """Connect an output to its ports; returns (last beat of a frame is taken, FIFO of its tags)."""
        name, source = output.name, getattr(self.datapath, output.name)
        m.submodules[f"{name}_port"] = raster = RasterPort(
            output.rows,
            output.beats,
            output.octets,
            tagged=output.tagged,
            void_octets=output.void_octets,
            rows_reversed=output.rows_reversed,
        )
        words = RASTERS[name].beat(source.payload, output.lanes)
        extended = [Signal(WORD, name=f"{name}_word_{k}") for k in range(len(words))]
        m.d.comb += [word.eq(value) for word, value in zip(extended, words, strict=True)]
        m.d.comb += [
            raster.i.payload.eq(Cat(extended)),
            raster.i.valid.eq(source.valid),
            source.ready.eq(raster.i.ready),
            raster.cut.eq(reset),
        ]
        for member, flow in raster.port.signature.members.items():
            port, signal = getattr(self, f"m_axis_{name}_{member}"), getattr(raster.port, member)
            m.d.comb += port.eq(signal) if flow.flow == Out else signal.eq(port)
        if not output.tagged:
            return raster.done, None
        tags, suspects = (fifo.SyncFIFO(width=1, depth=FRAMES_IN_FLIGHT) for _ in range(2))
        m.submodules[f"{name}_tags"] = ResetInserter(reset)(tags)
        # A frame's entry comes later than its tag and leaves with it, so the FIFO is never full.
        m.submodules[f"{name}_suspects"] = ResetInserter(reset)(suspects)
        m.d.comb += [
            tags.r_en.eq(raster.done),
            suspects.r_en.eq(raster.done),
            suspects.w_en.eq(self.datapath.suspect_valid),
            suspects.w_data.eq(self.datapath.suspect),
            raster.bad.eq(tags.r_data & tags.r_rdy),
            raster.suspect.eq(suspects.r_data & suspects.r_rdy),
        ]
        return raster.done, tags
