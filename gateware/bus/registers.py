"""Register block for the host: identity, control, status, errors, force and measured latencies."""

from amaranth import Cat, Const, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.axi_lite import AxiLiteSlave, Response, axi_lite_signature
from fastac.gateware.bus.calibration_loader import calibration_signature
from fastac.gateware.bus.frame_timer import STAMP, FrameTimer
from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.record import record_form
from fastac.gateware.bus.register_map import ADDRESS_WIDTH, ERRORS, ID
from fastac.gateware.bus.result_registers import ResultRegisters
from fastac.gateware.stream.frame_guard import EVENTS, TIMEOUT_BITS
from fastac.models.integer.frame_validity import REASONS

WORD = 32
"""Bits of a register."""
ERRORS_DETECTED_HERE = (
    *("result_overrun", "calibration_refused", "frame_suspect", "access_refused", "results_lost"),
)
"""Errors that the register block detects itself; the others are inputs."""


class RegisterBlock(wiring.Component):
    """The registers of the register map that `identity` has, behind AXI4-Lite, with the frame timer.

    Members
    -------
    axil : AXI4-Lite slave with 8-bit byte addresses. An access to an address without a register and a write
        to a read-only one read 0, change nothing and set ERRORS.access_refused. The response is OKAY, or
        with bus_errors "respond" DECERR and SLVERR; then a refused word of CALIBRATION gets SLVERR as well.
    accepted, frame_started, frame_done, frame_bad, line_short, line_long, frame_short, frame_long,
        no_start, frame_timeout : the outputs of FrameGuard
    timeout_clocks : the value of FRAME_TIMEOUT, FrameGuard's `timeout`
    gradient_saturated, displacement_saturated : set their bit of ERRORS in each clock in which they are high
    force : raw accumulators, signed(force_width) per axis, sampled with `result_valid`. Only with axes.
    result_valid : pulse when a frame's force is taken. Only with axes.
    half_widths, half_widths_valid : half-widths of the last force, unsigned(half_width_bits) per axis, and a
        pulse with them, before the next force. Only with half-widths.
    spread, touching : of the frame of that force, see SLIP_SPREAD and SLIP_DOTS. Only with slip.
    validity : flags of the result's frame, len(REASONS) bits, sampled with its result; see FRAME_VALIDITY
    depth_done, normals_done : pulse when the last beat of a frame's depth or normals is taken. Only with
        that output.
    background_taken : pulse when a frame has become the background. Only with background_capture.
    enable : accept frames
    capture_background : the next frame shall become the background. Only with background_capture.
    calibration : see `calibration_signature`. Only if a calibration can be loaded.
    record, record_valid : the record of a result (gateware/bus/record.py), valid in the clock of its pulse;
        one a result, in the order of the frames, a clock after it or after its half-widths. Only with
        packets.
    time : unsigned(64), clocks since reset. Only with packets.
    stamp : of the last whole frame, see FrameTimer. Only with packets of normals beside another result.
    soft_reset : high for one clock: reset the datapath including FrameGuard
    interrupt : level interrupt, high while INTERRUPT_STATUS and CONTROL.interrupt_enable are set

    A frame's result is its force; without force its depth; without both its normals. A flag that is set and
    cleared in the same clock stays set. FrameTimer defines the measured times.
    """

    def __init__(self, identity: Identity):
        self.identity = identity
        self.reported = [n for n in identity.errors if n not in ERRORS_DETECTED_HERE]
        inputs = [*EVENTS, *self.reported]
        outputs = ["soft_reset", "interrupt"]
        members = {
            "axil": In(axi_lite_signature(ADDRESS_WIDTH)),
            "enable": Out(1, init=1),
            "timeout_clocks": Out(TIMEOUT_BITS, init=identity.frame_timeout),
            "validity": In(len(REASONS)),
        }
        if identity.axes:
            inputs.append("result_valid")
            members["force"] = In(data.ArrayLayout(signed(identity.force_width), len(identity.axes)))
        if identity.slip:
            members |= {"spread": In(WORD), "touching": In(WORD)}
        if identity.half_width:
            inputs.append("half_widths_valid")
            halves = data.ArrayLayout(unsigned(identity.half_width_bits), len(identity.axes))
            members["half_widths"] = In(halves)
        inputs += [f"{name}_done" for name in ("depth", "normals") if getattr(identity, name)]
        if identity.background_capture:
            inputs.append("background_taken")
            outputs.append("capture_background")
        if identity.packets:
            outputs.append("record_valid")
            members |= {"record": Out(record_form(identity.half_width).bits), "time": Out(64)}
        if identity.early_normals:
            members["stamp"] = Out(STAMP)
        if identity.calibration:
            members["calibration"] = Out(calibration_signature())
        members |= {name: In(1) for name in inputs} | {name: Out(1) for name in outputs}
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        identity = self.identity
        offsets = {register.name: register.offset for register in identity.registers}

        m.submodules.slave = slave = AxiLiteSlave(ADDRESS_WIDTH)
        wiring.connect(m, wiring.flipped(self.axil), slave.axil)
        bus = slave.bus
        ones = bus.write_data & bus.write_mask  # bits written as 1
        kept = ~bus.write_mask  # bits not written

        def written(name):
            return bus.write & (bus.write_word == offsets[name] >> 2)

        def read(name):
            return bus.read & (bus.read_word == offsets[name] >> 2)

        m.submodules.timer = timer = FrameTimer(
            force=bool(identity.axes),
            depth=identity.depth,
            normals=identity.normals,
            packets=identity.packets,
            stamps=identity.early_normals,
        )
        if identity.early_normals:
            m.d.comb += self.stamp.eq(timer.stamp)
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
        result &= ~self.soft_reset  # a soft reset discards the frame

        # The value of CONTROL as read; the bits that a write does not change keep it.
        interrupt_enable = Signal()
        requested = Const(0, 1)
        if identity.background_capture:
            requested = self.capture_background & ~self.background_taken
        control = Cat(self.enable, requested, Const(0, 1), interrupt_enable)
        after = Mux(written("CONTROL"), (control & kept) | ones, control)
        m.d.sync += [self.enable.eq(after[0]), self.soft_reset.eq(after[2]), interrupt_enable.eq(after[3])]
        if identity.background_capture:
            m.d.sync += self.capture_background.eq(after[1] | requested)

        m.d.sync += self.timeout_clocks.eq(
            Mux(written("FRAME_TIMEOUT"), (self.timeout_clocks & kept) | ones, self.timeout_clocks)
        )

        errors = Signal(len(ERRORS))
        pending = Signal()
        result_valid = Signal()
        clear_errors = Signal.like(errors)
        clear_pending = Signal()
        seen = {name: getattr(self, name) for name in self.reported}
        seen["result_overrun"] = result & pending & ~clear_pending
        seen["frame_suspect"] = result & self.validity.any()
        access_refused = Signal()
        seen["access_refused"] = access_refused
        m.submodules.results = results = ResultRegisters(identity)
        m.d.comb += [results.result.eq(result), results.validity.eq(self.validity)]
        for axis in identity.axes:
            m.d.comb += getattr(results, f"read_force_{axis}").eq(read(f"FORCE_{axis.upper()}_LOW"))
        if identity.axes:
            m.d.comb += results.force.eq(self.force)
        if identity.half_width:
            m.d.comb += [
                results.half_widths.eq(self.half_widths),
                results.half_widths_valid.eq(self.half_widths_valid),
                results.sequence.eq(timer.force_number),
            ]
            for axis in identity.axes:
                reads = read(f"HALF_WIDTH_{axis.upper()}_LOW")
                m.d.comb += getattr(results, f"read_half_width_{axis}").eq(reads)
        loading, refused = Const(0, 1), Const(0, 1)
        bundle_hash = Const(identity.bundle_hash, 64)
        if identity.calibration:
            loader = self.calibration
            loading, bundle_hash = loader.loading, loader.bundle_hash
            refused = written("CALIBRATION") & ~loader.taken
            seen["calibration_refused"] = refused
            m.d.comb += [
                loader.write.eq(written("CALIBRATION") & bus.write_mask.all()),
                loader.word.eq(bus.write_data),
                loader.idle.eq(~timer.in_flight.any()),
                loader.restart.eq(written("CONTROL") & ones[4]),
            ]
        m.d.comb += [
            clear_errors.eq(Mux(written("ERRORS"), ones, 0)),
            clear_pending.eq(written("INTERRUPT_STATUS") & ones[0]),
            self.interrupt.eq(pending & interrupt_enable),
        ]
        m.d.sync += [
            pending.eq((pending & ~clear_pending) | result),
            result_valid.eq((result_valid | result) & ~self.soft_reset),
        ]

        slipping = Const(0, 1)
        if identity.slip:
            limit = Signal(WORD, init=identity.slip_limit)
            slipping = results.last_spread > limit
            m.d.comb += [results.spread.eq(self.spread), results.touching.eq(self.touching)]
            m.d.sync += limit.eq(Mux(written("SLIP_LIMIT"), (limit & kept) | ones, limit))

        if identity.packets and identity.half_width:
            m.d.comb += results.cut.eq(self.soft_reset)
        if identity.packets:
            kind = timer.result
            m.d.sync += self.time.eq(self.time + 1)
            seen["results_lost"] = results.lost
            m.d.comb += [
                results.frame.eq(getattr(timer, f"{kind}_number")),
                results.bad.eq(getattr(timer, f"{kind}_bad")),
                results.first_to_result.eq(getattr(timer, f"first_to_{kind}")),
                results.last_to_result.eq(getattr(timer, f"last_to_{kind}")),
                results.result_time.eq(timer.result_time),
                results.time.eq(self.time),
                results.slipping.eq(slipping),
                results.errors.eq(errors),
                results.read_time.eq(read("TIME_LOW")),
                results.read.eq(read("RESULTS_WORD")),
                results.clear.eq(written("CONTROL") & ones[5]),
                self.record.eq(results.record),
                self.record_valid.eq(results.record_valid),
                timer.time.eq(self.time),
            ]

        m.d.sync += errors.eq((errors & ~clear_errors) | Cat(seen.get(name, 0) for name in ERRORS))

        frame_errors = Signal(32)
        m.d.sync += frame_errors.eq(frame_errors + (self.frame_done & self.frame_bad & ~self.soft_reset))

        values = {
            "ID": ID,
            "VERSION": identity.version,
            "BUNDLE_HASH_LOW": bundle_hash[:32],
            "BUNDLE_HASH_HIGH": bundle_hash[32:],
            "GEOMETRY": identity.height | identity.width << 16,
            "CAPABILITIES": identity.capabilities,
            "CONTROL": control,
            "STATUS": Cat(
                timer.in_flight.any(),
                result_valid,
                getattr(timer, f"{identity.result}_bad"),
                loading,
                results.frame_validity.any(),
                slipping,
                Const(0, 2),
                timer.in_flight,
            ),
            "ERRORS": errors,
            "INTERRUPT_STATUS": pending,
            "FRAME_ERRORS": frame_errors,
            "FRAME_TIMEOUT": self.timeout_clocks,
            **timer.values,
            **results.values,
        }
        if identity.slip:
            values["SLIP_LIMIT"] = limit
        if identity.calibration:
            values |= {
                "CALIBRATION": Const(0, 32),
                "CALIBRATION_LAYOUT": identity.calibration_layout,
                "CALIBRATION_WORDS": identity.calibration_words,
                "CALIBRATION_RECEIVED": self.calibration.received,
            }

        responds = identity.bus_errors == "respond"
        no_register = Response.DECERR if responds else Response.OKAY
        not_now = Response.SLVERR if responds else Response.OKAY
        unreadable, unwritable = Signal(), Signal()
        m.d.comb += [
            bus.read_response.eq(no_register),
            bus.write_response.eq(no_register),
            unreadable.eq(1),
            unwritable.eq(1),
            access_refused.eq((bus.read & unreadable) | (bus.write & unwritable)),
        ]
        with m.Switch(bus.read_word):
            for register in identity.registers:
                with m.Case(register.offset >> 2):
                    m.d.comb += [
                        bus.read_data.eq(values[register.name]),
                        bus.read_response.eq(Response.OKAY),
                        unreadable.eq(0),
                    ]
        with m.Switch(bus.write_word):
            for register in identity.registers:
                read_only = register.access == "ro"
                answer = not_now if read_only else Response.OKAY
                if register.name == "CALIBRATION":
                    answer = Mux(refused, not_now, Response.OKAY)
                with m.Case(register.offset >> 2):
                    m.d.comb += [bus.write_response.eq(answer), unwritable.eq(read_only)]
        return m
