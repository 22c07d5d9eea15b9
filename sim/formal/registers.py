"""Proof of the register block against the register map: who may read, write, set and clear which bit."""

from functools import partial

from amaranth import Array, Cat, Const, Mux, Signal, Value, signed

from fastac.gateware.bus.axi_lite import Response
from fastac.gateware.bus.register_map import ADDRESS_WIDTH, ERRORS, ID, Identity
from fastac.gateware.bus.registers import RegisterBlock, capabilities
from fastac.models.integer.frame_validity import REASONS
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof

WORDS = 1 << (ADDRESS_WIDTH - 2)
FORCE_WIDTH = 40
FULL = Identity(
    *(0xFEDCBA9876543210, 4, 120, 300, 4, 2, "xyz"),
    force_width=FORCE_WIDTH,
    background_capture=True,
    normals=True,
    frame_timeout=15_000_000,
)
LOADABLE = Identity(
    *(0xFEDCBA9876543210, 4, 120, 300, 4, 2, "z"),
    calibration_words=70_000,
    calibration_layout=0xFEDCBA98,
    bus_errors="respond",
)


def registers(component: type, identity: Identity) -> FormalBench:
    """All inputs are free; accesses are those that leave the AXI4-Lite slave, which has its own proof."""
    bench = FormalBench(component(identity))
    m, dut = bench.m, bench.dut
    offsets = {register.name: register.offset for register in identity.registers}

    def bus(name: str, bits: int = 1) -> Signal:
        return bench.probe(f"slave.bus__{name}", bits)

    read, read_word, read_data = bus("read"), bus("read_word", ADDRESS_WIDTH - 2), bus("read_data", 32)
    write, write_word, data = bus("write"), bus("write_word", ADDRESS_WIDTH - 2), bus("write_data", 32)
    mask, answers = bus("write_mask", 32), [bus("read_response", 2), bus("write_response", 2)]
    ones = bench.wire("ones", data & mask)

    def named(word: Signal, access: Signal, name: str) -> Signal:
        return bench.wire(f"{name}_{word.name}", access & (word == offsets[name] >> 2))

    inputs = {
        path[0]: bench.free(path[0], len(Value.cast(value)))
        for path, member, value in dut.signature.flatten(dut)
        if len(path) == 1 and member.flow.name == "In"
    }
    for name, signal in inputs.items():
        bench.drive(getattr(dut, name), signal)

    # rw: only the bits that a write's strobes choose change, and only at the register's address.
    control = named(write_word, write, "CONTROL")
    shadow = {"enable": Signal(init=1), "interrupt_enable": Signal(), "soft_reset": Signal()}
    for bit, name in ((0, "enable"), (3, "interrupt_enable")):
        with m.If(control & mask[bit]):
            m.d.sync += shadow[name].eq(data[bit])
    m.d.sync += shadow["soft_reset"].eq(control & ones[2])
    timeout = Signal(32, init=identity.frame_timeout)
    m.d.sync += timeout.eq(Mux(named(write_word, write, "FRAME_TIMEOUT"), (timeout & ~mask) | ones, timeout))
    bench.always("CONTROL.enable is what was last written", dut.enable == shadow["enable"])
    bench.always("CONTROL.soft_reset is a pulse", dut.soft_reset == shadow["soft_reset"])
    bench.always("FRAME_TIMEOUT is what was last written", dut.timeout_clocks == timeout)

    # The result: a soft reset discards the frame.
    result = bench.wire("result", inputs[_result_input(identity)] & ~dut.soft_reset)
    pending, validity = Signal(), Signal(len(REASONS))
    cleared = named(write_word, write, "INTERRUPT_STATUS") & ones[0]
    m.d.sync += pending.eq((pending & ~cleared) | result)
    with m.If(result):
        m.d.sync += validity.eq(inputs["validity"])
    bench.always(
        "the interrupt follows its status and enable", dut.interrupt == (pending & shadow["interrupt_enable"])
    )

    # w1c: a flag is set by its event, stays, and a written 1 clears it unless it is set in that clock.
    kinds = {register.offset >> 2: register.access for register in identity.registers}
    absent = Array(k not in kinds for k in range(WORDS))
    read_only = Array(kinds.get(k) == "ro" for k in range(WORDS))
    unmapped_read = bench.wire("unmapped_read", read & absent[read_word])
    unmapped_write = bench.wire("unmapped_write", write & absent[write_word])
    refused_write = bench.wire("refused_write", write & read_only[write_word])
    events = {name: signal for name, signal in inputs.items() if name in ERRORS}
    events["result_overrun"] = result & pending & ~cleared
    events["frame_suspect"] = result & inputs["validity"].any()
    events["access_refused"] = unmapped_read | unmapped_write | refused_write
    word_refused = Const(0)
    if identity.calibration:
        taken = bench.free("calibration_taken")
        bench.drive(dut.calibration.taken, taken)
        loaded = named(write_word, write, "CALIBRATION")
        word_refused = loaded & ~taken
        events["calibration_refused"] = word_refused
        bench.always(
            "only a whole word of CALIBRATION is offered", dut.calibration.write == (loaded & mask.all())
        )
        bench.always("the word of CALIBRATION is the one written", dut.calibration.word == data)
        bench.always("a restart is asked for by its bit", dut.calibration.restart == (control & ones[4]))
    errors = Signal(len(ERRORS))
    clear = Mux(named(write_word, write, "ERRORS"), ones, 0)
    m.d.sync += errors.eq((errors & ~clear) | Cat(events.get(name, 0) for name in ERRORS))

    # Forces: LOW is the last result's, and reading it latches HIGH, so that both belong together.
    forces = {}
    for k, axis in enumerate(identity.axes):
        force, high = Signal(signed(64), name=f"{axis}_force"), Signal(32, name=f"{axis}_high")
        width = identity.force_width
        with m.If(result):
            m.d.sync += force.eq(inputs["force"].word_select(k, width).as_signed())
        with m.If(named(read_word, read, f"FORCE_{axis.upper()}_LOW")):
            m.d.sync += high.eq(force[32:])
        inner, latched = bench.probe(f"force_{axis}", 64), bench.probe(f"force_{axis}_high", 32)
        bench.always(f"the registers of force {axis}", (inner == force.as_unsigned()) & (latched == high))
        forces |= {f"FORCE_{axis.upper()}_LOW": force[:32], f"FORCE_{axis.upper()}_HIGH": high}

    expected = {
        "ID": Const(ID, 32),
        "VERSION": Const(identity.version, 32),
        "GEOMETRY": Const(identity.height | identity.width << 16, 32),
        "CAPABILITIES": Const(capabilities(identity), 32),
        "ERRORS": errors,
        "INTERRUPT_STATUS": pending,
        "FRAME_VALIDITY": validity,
        "FRAME_TIMEOUT": timeout,
        **forces,
    }
    if not identity.calibration:
        low, high = identity.bundle_hash & 0xFFFFFFFF, identity.bundle_hash >> 32
        expected |= {"BUNDLE_HASH_LOW": Const(low, 32), "BUNDLE_HASH_HIGH": Const(high, 32)}
    for name, value in expected.items():
        wrong = named(read_word, read, name) & (read_data != value)
        bench.always(f"{name} reads as the register map says", ~wrong)
    bits = named(read_word, read, "CONTROL")
    state = Cat(
        read_data[0] == shadow["enable"], read_data[2] == 0, read_data[3] == shadow["interrupt_enable"]
    )
    bench.always("CONTROL reads as the register map says", ~bits | (state.all() & (read_data[4:] == 0)))
    bench.always("an address without a register reads 0", ~unmapped_read | (read_data == 0))

    # Answers: OKAY, or if the scene asks for it, DECERR without a register and SLVERR for a refused write.
    responds = identity.bus_errors == "respond"
    decerr = Response.DECERR if responds else Response.OKAY
    slverr = Response.SLVERR if responds else Response.OKAY
    right_read = answers[0] == Mux(unmapped_read, decerr, Response.OKAY)
    right_write = answers[1] == Mux(
        unmapped_write, decerr, Mux(refused_write | word_refused, slverr, Response.OKAY)
    )
    bench.always("a read's response", ~read | right_read)
    bench.always("a write's response", ~write | right_write)
    for name, inner in (("errors", errors), ("pending", pending), ("frame_validity", validity)):
        bench.always(f"the register {name}", bench.probe(name, len(inner)) == inner)
    bench.always(
        "the register interrupt_enable", bench.probe("interrupt_enable") == shadow["interrupt_enable"]
    )
    return bench


def _result_input(identity: Identity) -> str:
    return "result_valid" if identity.axes else f"{identity.result}_done"


PROOFS = (
    Proof(
        "registers_full",
        RegisterBlock,
        "three axes of force, depth, normals and background capture; errors are flagged",
        partial(registers, identity=FULL),
        depth=2,
        breaks=(
            ("(control & kept) | ones, control)", "ones, control)"),
            ("(errors & ~clear_errors)", "(errors & ~ones)"),
            ("unwritable.eq(read_only)", "unwritable.eq(0)"),
            ("(pending & ~clear_pending) | result", "pending & ~clear_pending | result & ~pending"),
            ("with m.If(read(low)):", "with m.If(read(high)):"),
            ("result &= ~self.soft_reset", "result &= 1"),
        ),
        quick=True,
    ),
    Proof(
        "registers_loadable",
        RegisterBlock,
        "force z, depth, calibrations can be loaded; refused accesses are answered by errors",
        partial(registers, identity=LOADABLE),
        depth=2,
        breaks=(
            (
                'loader.write.eq(written("CALIBRATION") & bus.write_mask.all())',
                'loader.write.eq(written("CALIBRATION"))',
            ),
            ("answer = Mux(refused, not_now, Response.OKAY)", "answer = Response.OKAY"),
            ('loader.restart.eq(written("CONTROL") & ones[4])', "loader.restart.eq(ones[4])"),
        ),
    ),
)
