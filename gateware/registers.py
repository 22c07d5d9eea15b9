"""The registers a host sees: what the hardware is, what it does, and what it measured."""

from amaranth import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from .axi_lite import AxiLiteSlave, Response, axi_lite_signature
from .frame_guard import EVENTS
from .frame_timer import FrameTimer
from .register_map import ADDRESS_WIDTH, AXES, ERRORS, ID, Identity


class RegisterBlock(wiring.Component):
    """The registers of the map that exist for `identity`, behind AXI4-Lite, with the frame timer.

    Members
    -------
    axil : AXI4-Lite with addresses of 8 bits; DECERR without a register, SLVERR on writing a read-only one
    accepted, frame_started, frame_done, frame_bad, line_short, line_long, frame_short, frame_long,
        no_start : from FrameGuard
    gradient_saturated, displacement_saturated : pulses or levels that set their error
    force : `axes` raw accumulators, signed(force_width), of the clock in which `result_valid` is high
    result_valid : pulse as a frame's force is taken. Only with axes, as `force`.
    depth_done, normals_done : pulse as a frame's last beat of depth, of normals leaves. Only with them.
    background_taken : pulse as a frame that is taken as background starts. Only with background_capture.
    enable : let frames in
    capture_background : the next frame is wanted as background. Only with background_capture.
    soft_reset : for one clock: reset the datapath, FrameGuard included
    interrupt : level

    A result is a force or, where there is none, a whole depth map, else a whole map of normals. What comes
    and what is cleared in the same clock stays set. See FrameTimer for what the times mean.
    """

    def __init__(self, identity: Identity):
        self.identity = identity
        inputs = [*EVENTS, *(name for name in ERRORS if name != "result_overrun")]
        outputs = ["soft_reset", "interrupt"]
        members = {"axil": In(axi_lite_signature(ADDRESS_WIDTH)), "enable": Out(1, init=1)}
        if identity.axes:
            inputs.append("result_valid")
            members["force"] = In(data.ArrayLayout(signed(identity.force_width), identity.axes))
        inputs += [f"{name}_done" for name in ("depth", "normals") if getattr(identity, name)]
        if identity.background_capture:
            inputs.append("background_taken")
            outputs.append("capture_background")
        members |= {name: In(1) for name in inputs} | {name: Out(1) for name in outputs}
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        identity = self.identity
        offsets = {register.name: register.offset for register in identity.registers}

        m.submodules.slave = slave = AxiLiteSlave(ADDRESS_WIDTH)
        wiring.connect(m, wiring.flipped(self.axil), slave.axil)
        bus = slave.bus
        ones = bus.write_data & bus.write_mask  # the ones that are written
        kept = ~bus.write_mask  # the bits that are not

        def written(name):
            return bus.write & (bus.write_word == offsets[name] >> 2)

        def read(name):
            return bus.read & (bus.read_word == offsets[name] >> 2)

        m.submodules.timer = timer = FrameTimer(
            force=identity.axes > 0, depth=identity.depth, normals=identity.normals
        )
        for name in EVENTS:
            m.d.comb += getattr(timer, name).eq(getattr(self, name))
        m.d.comb += timer.flush.eq(self.soft_reset)
        if identity.axes:
            m.d.comb += timer.result_valid.eq(self.result_valid)
        if identity.depth:
            m.d.comb += timer.depth_done.eq(self.depth_done)
        if identity.normals:
            m.d.comb += timer.normals_done.eq(self.normals_done)
        result = self.result_valid if identity.axes else getattr(self, f"{identity.result}_done")

        # CONTROL as it is read and, but for what a write changes, as it stays.
        interrupt_enable = Signal()
        requested = Const(0, 1)
        if identity.background_capture:
            requested = self.capture_background & ~self.background_taken
        control = Cat(self.enable, requested, Const(0, 1), interrupt_enable)
        after = Mux(written("CONTROL"), (control & kept) | ones, control)
        m.d.sync += [self.enable.eq(after[0]), self.soft_reset.eq(after[2]), interrupt_enable.eq(after[3])]
        if identity.background_capture:
            m.d.sync += self.capture_background.eq(after[1])

        errors = Signal(len(ERRORS))
        pending = Signal()
        result_valid = Signal()
        clear_errors = Signal.like(errors)
        clear_pending = Signal()
        seen = [getattr(self, name) for name in ERRORS[:-1]]
        m.d.comb += [
            clear_errors.eq(Mux(written("ERRORS"), ones, 0)),
            clear_pending.eq(written("INTERRUPT_STATUS") & ones[0]),
            self.interrupt.eq(pending & interrupt_enable),
        ]
        m.d.sync += [
            errors.eq((errors & ~clear_errors) | Cat(*seen, result & pending & ~clear_pending)),
            pending.eq((pending & ~clear_pending) | result),
            result_valid.eq((result_valid | result) & ~self.soft_reset),
        ]

        frame_errors = Signal(32)
        m.d.sync += frame_errors.eq(frame_errors + (self.frame_done & self.frame_bad))

        flags = identity.depth << 2 | identity.background_capture << 3 | identity.normals << 4
        values = {
            "ID": ID,
            "VERSION": identity.version,
            "BUNDLE_HASH_LOW": identity.bundle_hash & 0xFFFFFFFF,
            "BUNDLE_HASH_HIGH": identity.bundle_hash >> 32,
            "GEOMETRY": identity.height | identity.width << 16,
            "CAPABILITIES": identity.channels | identity.lanes << 8 | (identity.axes | flags) << 16,
            "CONTROL": control,
            "STATUS": Cat(
                timer.in_flight.any(),
                result_valid,
                getattr(timer, f"{identity.result}_bad"),
                Const(0, 5),
                timer.in_flight,
            ),
            "ERRORS": errors,
            "INTERRUPT_STATUS": pending,
            "FRAME_COUNT": timer.frame_count,
            "FRAME_ERRORS": frame_errors,
            "INTERVAL": timer.interval,
        }
        if identity.axes:
            values |= {
                "LATENCY_FIRST_PIXEL_TO_FORCE": timer.first_to_force,
                "LATENCY_LAST_PIXEL_TO_FORCE": timer.last_to_force,
                "FORCE_SEQUENCE": timer.force_number,
            }
        if identity.depth:
            values["LATENCY_FIRST_PIXEL_TO_DEPTH"] = timer.first_to_depth
        if identity.normals:
            values["LATENCY_FIRST_PIXEL_TO_NORMALS"] = timer.first_to_normals
        for axis, accumulator in zip(AXES[identity.axes], self.force if identity.axes else (), strict=True):
            force = Signal(signed(64), name=f"force_{axis}")
            held = Signal(32, name=f"force_{axis}_high")
            low, high = f"FORCE_{axis.upper()}_LOW", f"FORCE_{axis.upper()}_HIGH"
            with m.If(result):
                m.d.sync += force.eq(accumulator)
            with m.If(read(low)):
                m.d.sync += held.eq(force[32:])
            values |= {low: force[:32], high: held}

        m.d.comb += [
            bus.read_response.eq(Response.DECERR),
            bus.write_response.eq(Response.DECERR),
        ]
        with m.Switch(bus.read_word):
            for register in identity.registers:
                with m.Case(register.offset >> 2):
                    m.d.comb += [
                        bus.read_data.eq(values[register.name]),
                        bus.read_response.eq(Response.OKAY),
                    ]
        with m.Switch(bus.write_word):
            for register in identity.registers:
                answer = Response.SLVERR if register.access == "ro" else Response.OKAY
                with m.Case(register.offset >> 2):
                    m.d.comb += bus.write_response.eq(answer)
        return m
