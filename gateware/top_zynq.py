# amaranth: UnusedElaboratable=no
"""The top-level for the Zynq's programmable logic: AXI in, AXI out, registers and an interrupt."""

from amaranth import Cat, Const, Module, ResetInserter, Signal
from amaranth.lib import fifo, wiring
from amaranth.lib.wiring import In, Out

from models.bundle import Bundle

from .axi_lite import axi_lite_signature
from .datapath import Datapath
from .frame_guard import ERRORS, EVENTS, axis_signature
from .register_map import ADDRESS_WIDTH, Identity
from .registers import RegisterBlock

VERSION = 1
"""Of the hardware and of its register map."""
WORD = 32
"""Bits of one value on the output streams."""
FRAMES_IN_FLIGHT = 8


def flat(prefix: str, signature: wiring.Signature, direction) -> dict[str, wiring.Member]:
    """The members of a bus as ports of their own, `prefix`_member, as Vivado recognises them."""
    members = signature.members if direction == Out else signature.flip().members
    return {f"{prefix}_{name}": member for name, member in members.items()}


class TopZynq(wiring.Component):
    """A bundle as an IP core.

    Members
    -------
    s_axis_* : AXI4-Stream of frames; tdata: `lanes` pixels of 8-bit channels in the scene's order, lane 0 and
        channel 0 lowest; tuser: start of frame; tlast: end of line
    s_axil_* : AXI4-Lite, the registers of gateware/register_map.py
    m_axis_depth_* : AXI4-Stream of depth, `lanes` signed 32-bit words, N rows of N values, N = width − 2;
        tkeep: bytes of lanes that hold a value; tlast: end of row; tuser[0]: start of frame; tuser[1]: the
        frame is bad. Only if the scene wants depth.
    m_axis_normals_* : the same for normals: three signed 32-bit words (x, y, z) of any length per pixel,
        height × width pixels; tuser: start of frame. Only if the scene wants normals.
    interrupt : level, see the registers

    What a frame's stream could not say in time is in STATUS and ERRORS: a bad frame's force is marked there.
    A soft reset ends the frames under way where they are, also on the output streams, which then begin anew
    with a start of frame.
    """

    def __init__(self, bundle: Bundle):
        pipeline, scene = bundle.pipeline, bundle.scene
        self.bundle = bundle
        self.datapath = Datapath(pipeline)
        self.lanes = self.datapath.lanes
        for name, width in (
            ("depth", pipeline.depth.width if self.datapath.wants_depth else 0),
            ("normals", pipeline.layers[-1].accumulator_width),
        ):
            if width > WORD:
                raise ValueError(f"{name} of {width} bits: expected at most {WORD}, a word of the stream")
        self.identity = Identity(
            bundle_hash=bundle.hash_word,
            version=VERSION,
            height=scene.sensor.height_px,
            width=scene.sensor.width_px,
            channels=len(scene.sensor.channel_names),
            lanes=self.lanes,
            axes=len(pipeline.force.kernel) if self.datapath.wants_force else 0,
            force_width=pipeline.force.width if self.datapath.wants_force else 64,
            depth=self.datapath.wants_depth,
            background_capture=True,
            normals=self.datapath.wants_normals,
        )
        members = {
            **flat("s_axis", self.datapath.axis.signature.flip(), In),
            **flat("s_axil", axi_lite_signature(ADDRESS_WIDTH), In),
            "interrupt": Out(1),
        }
        if self.datapath.wants_depth:
            members |= flat("m_axis_depth", axis_signature(WORD * self.lanes), Out)
            members["m_axis_depth_tuser"] = Out(2)
            members["m_axis_depth_tkeep"] = Out(WORD // 8 * self.lanes)
        if self.datapath.wants_normals:
            members |= flat("m_axis_normals", axis_signature(3 * WORD * self.lanes), Out)
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        m.submodules.registers = registers = RegisterBlock(self.identity)
        path = self.datapath
        m.submodules.datapath = ResetInserter(registers.soft_reset)(path)

        for prefix, bus in (("s_axis", path.axis), ("s_axil", registers.axil)):
            for name, member in bus.signature.members.items():
                port, signal = getattr(self, f"{prefix}_{name}"), getattr(bus, name)
                m.d.comb += signal.eq(port) if member.flow == In else port.eq(signal)
        m.d.comb += [
            path.enable.eq(registers.enable),
            path.capture.eq(registers.capture_background),
            self.interrupt.eq(registers.interrupt),
            registers.gradient_saturated.eq(path.gradient_saturated),
            registers.displacement_saturated.eq(path.displacement_saturated),
            Cat(getattr(registers, n) for n in (*EVENTS, *ERRORS)).eq(
                Cat(getattr(path, n) for n in (*EVENTS, *ERRORS))
            ),
        ]
        captured = Signal()
        m.d.sync += captured.eq(path.capturing)
        m.d.comb += registers.background_taken.eq(path.capturing & ~captured)

        if path.wants_force:
            m.d.comb += [
                path.force.ready.eq(1),
                registers.result_valid.eq(path.force.valid),
                registers.force.eq(path.force.payload),
            ]
        if path.wants_depth:
            m.submodules.tags = tags = ResetInserter(registers.soft_reset)(
                fifo.SyncFIFO(width=1, depth=FRAMES_IN_FLIGHT)
            )
            size, lanes = self.identity.width - 2, self.lanes
            rows = {"rows": size, "beats": -(-size // lanes)}
            first, last, done = self._raster(m, "depth", path.depth, registers.soft_reset, **rows)
            void = -size % lanes
            full = (1 << (WORD // 8 * lanes)) - 1
            m.d.comb += [
                tags.w_data.eq(path.tag.payload),
                tags.w_en.eq(path.tag.valid),
                path.tag.ready.eq(tags.w_rdy),
                tags.r_en.eq(done),
                self.m_axis_depth_tuser.eq(Cat(first, tags.r_data & tags.r_rdy)),
                self.m_axis_depth_tkeep.eq(Const(full)),
                registers.depth_done.eq(done),
            ]
            with m.If(last):
                m.d.comb += self.m_axis_depth_tkeep.eq(full >> (WORD // 8 * void))
        else:
            m.d.comb += path.tag.ready.eq(1)
        if path.wants_normals:
            rows = {"rows": self.identity.height, "beats": self.identity.width // self.lanes}
            first, _, done = self._raster(m, "normals", path.normals, registers.soft_reset, **rows)
            m.d.comb += [self.m_axis_normals_tuser.eq(first), registers.normals_done.eq(done)]
        return m

    def _raster(self, m, name: str, source, reset, *, rows: int, beats: int):
        """Connect a stream to `m_axis_name`; returns start of frame, end of line, and whole frame taken."""
        port = {k: getattr(self, f"m_axis_{name}_{k}") for k in ("tdata", "tvalid", "tready", "tlast")}
        x, y = Signal(range(beats), name=f"{name}_x"), Signal(range(rows), name=f"{name}_y")
        first, last, done = (Signal(name=f"{name}_{k}") for k in ("first", "last", "done"))
        words = []
        for lane in source.payload:
            words += [lane] if name == "depth" else list(lane)
        extended = [Signal(WORD, name=f"{name}_word_{k}") for k in range(len(words))]
        m.d.comb += [word.eq(value) for word, value in zip(extended, words, strict=True)]
        m.d.comb += [
            port["tdata"].eq(Cat(extended)),
            port["tvalid"].eq(source.valid),
            source.ready.eq(port["tready"]),
            port["tlast"].eq(last),
            first.eq((x == 0) & (y == 0)),
            last.eq(x == beats - 1),
            done.eq(source.valid & source.ready & last & (y == rows - 1)),
        ]
        with m.If(source.valid & source.ready):
            m.d.sync += x.eq(x + 1)
            with m.If(last):
                m.d.sync += [x.eq(0), y.eq(y + 1)]
                with m.If(y == rows - 1):
                    m.d.sync += y.eq(0)
        with m.If(reset):
            m.d.sync += [x.eq(0), y.eq(0)]
        return first, last, done
