"""Proof of the register block against the register map: who may read, write, set and clear which bit."""

from functools import partial

from amaranth import Array, Cat, Const, Mux, Signal, Value, signed

from fastac.gateware.bus.axi_lite import Response
from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.register_map import ADDRESS_WIDTH, ERRORS, ID
from fastac.gateware.bus.registers import RegisterBlock
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
    slip=True,
    slip_limit=369,
    frame_timeout=15_000_000,
)
LOADABLE = Identity(
    *(0xFEDCBA9876543210, 4, 120, 300, 4, 2, "z"),
    calibration_words=70_000,
    calibration_layout=0xFEDCBA98,
    bus_errors="respond",
)


class Rules:
    """The register block with what its registers must hold, kept beside it from the bus and the inputs.

    All inputs are free; accesses are those that leave the AXI4-Lite slave, which has its own proof.
    """

    def __init__(self, component: type, identity: Identity):
        self.identity = identity
        self.bench = bench = FormalBench(component(identity))
        self.m, self.dut = bench.m, bench.dut
        self.offsets = {register.name: register.offset for register in identity.registers}
        self.kinds = {register.offset >> 2: register.access for register in identity.registers}

        def bus(name: str, bits: int = 1) -> Signal:
            return bench.probe(f"slave.bus__{name}", bits)

        word = ADDRESS_WIDTH - 2
        self.read, self.read_word, self.read_data = bus("read"), bus("read_word", word), bus("read_data", 32)
        self.write, self.write_word, self.data = (
            bus("write"),
            bus("write_word", word),
            bus("write_data", 32),
        )
        self.mask = bus("write_mask", 32)
        self.read_answer, self.write_answer = bus("read_response", 2), bus("write_response", 2)
        self.ones = bench.wire("ones", self.data & self.mask)
        self.inputs = {
            path[0]: bench.free(path[0], len(Value.cast(value)))
            for path, member, value in self.dut.signature.flatten(self.dut)
            if len(path) == 1 and member.flow.name == "In"
        }
        for name, signal in self.inputs.items():
            bench.drive(getattr(self.dut, name), signal)
        # A soft reset discards the frame.
        end = "result_valid" if identity.axes else f"{identity.result}_done"
        self.result = bench.wire("result", self.inputs[end] & ~self.dut.soft_reset)

    def reads(self, name: str) -> Signal:
        """The register `name` is read in this clock."""
        return self._named(self.read_word, self.read, name)

    def writes(self, name: str) -> Signal:
        """The register `name` is written in this clock."""
        return self._named(self.write_word, self.write, name)

    def _named(self, word: Signal, access: Signal, name: str) -> Signal:
        return self.bench.wire(f"{name}_{word.name}", access & (word == self.offsets[name] >> 2))

    def settings(self) -> dict[str, Value]:
        """Registers that are written: only the bits that a write's strobes choose change, and only there."""
        m, bench, dut = self.m, self.bench, self.dut
        control = self.writes("CONTROL")
        shadow = {"enable": Signal(init=1), "interrupt_enable": Signal(), "soft_reset": Signal()}
        for bit, name in ((0, "enable"), (3, "interrupt_enable")):
            with m.If(control & self.mask[bit]):
                m.d.sync += shadow[name].eq(self.data[bit])
        m.d.sync += shadow["soft_reset"].eq(control & self.ones[2])
        timeout = Signal(32, init=self.identity.frame_timeout)
        written = (timeout & ~self.mask) | self.ones
        m.d.sync += timeout.eq(Mux(self.writes("FRAME_TIMEOUT"), written, timeout))
        bench.always("CONTROL.enable is what was last written", dut.enable == shadow["enable"])
        bench.always("CONTROL.soft_reset is a pulse", dut.soft_reset == shadow["soft_reset"])
        bench.always("FRAME_TIMEOUT is what was last written", dut.timeout_clocks == timeout)
        enabled = shadow["interrupt_enable"]
        read = self.read_data
        bits = Cat(read[0] == shadow["enable"], read[2] == 0, read[3] == enabled)
        right = bits.all() & (read[4:] == 0)
        bench.always("CONTROL reads as the register map says", ~self.reads("CONTROL") | right)
        bench.always("the register interrupt_enable", bench.probe("interrupt_enable") == enabled)
        self.control, self.interrupt_enable = control, enabled
        return {"FRAME_TIMEOUT": timeout}

    def slip(self) -> dict[str, Value]:
        """The spread of the last result's frame, and whether it is beyond the limit that was last written."""
        if not self.identity.slip:
            return {}
        m, bench = self.m, self.bench
        spread, touching, limit = Signal(32), Signal(32), Signal(32, init=self.identity.slip_limit)
        with m.If(self.result):
            m.d.sync += [spread.eq(self.inputs["spread"]), touching.eq(self.inputs["touching"])]
        written = (limit & ~self.mask) | self.ones
        m.d.sync += limit.eq(Mux(self.writes("SLIP_LIMIT"), written, limit))
        inner = {"spread": "results.last_spread", "touching": "results.last_touching", "limit": "limit"}
        for name, own in (("spread", spread), ("touching", touching), ("limit", limit)):
            bench.always(f"the register {name}", bench.probe(inner[name], 32) == own)
        slips = self.read_data[5] == (spread > limit)
        bench.always("STATUS says whether the frame slips", ~self.reads("STATUS") | slips)
        return {"SLIP_SPREAD": spread, "SLIP_DOTS": touching, "SLIP_LIMIT": limit}

    def results(self) -> dict[str, Value]:
        """What a frame's end leaves: interrupt, validity, and forces whose two halves belong together."""
        m, bench = self.m, self.bench
        pending, validity = Signal(), Signal(len(REASONS))
        self.cleared = self.writes("INTERRUPT_STATUS") & self.ones[0]
        m.d.sync += pending.eq((pending & ~self.cleared) | self.result)
        with m.If(self.result):
            m.d.sync += validity.eq(self.inputs["validity"])
        interrupt = self.dut.interrupt == (pending & self.interrupt_enable)
        bench.always("the interrupt follows its status and enable", interrupt)
        self.pending = pending
        found = {"INTERRUPT_STATUS": pending, "FRAME_VALIDITY": validity}
        width = self.identity.force_width
        self.high_halves = {}
        for k, axis in enumerate(self.identity.axes):
            force, high = Signal(signed(64), name=f"{axis}_force"), Signal(32, name=f"{axis}_high")
            with m.If(self.result):
                m.d.sync += force.eq(self.inputs["force"].word_select(k, width).as_signed())
            with m.If(self.reads(f"FORCE_{axis.upper()}_LOW")):  # latches the other half
                m.d.sync += high.eq(force[32:])
            inner = bench.probe(f"results.force_{axis}", 64)
            latched = bench.probe(f"results.force_{axis}_high", 32)
            self.high_halves[axis] = force[32:]
            right = (inner == force.as_unsigned()) & (latched == high)
            bench.always(f"the registers of force {axis}", right)
            found |= {f"FORCE_{axis.upper()}_LOW": force[:32], f"FORCE_{axis.upper()}_HIGH": high}
        for name, inner in (("pending", pending), ("results.frame_validity", validity)):
            own = bench.probe(name, len(inner))
            bench.always(f"the register {name.removeprefix('results.')}", own == inner)
        return found

    def calibration(self) -> Value:
        """Words of a calibration go to its loader; returns whether one is refused."""
        bench, dut = self.bench, self.dut
        taken = bench.free("calibration_taken")
        bench.drive(dut.calibration.taken, taken)
        loaded = self.writes("CALIBRATION")
        whole = dut.calibration.write == (loaded & self.mask.all())
        bench.always("only a whole word of CALIBRATION is offered", whole)
        bench.always("the word of CALIBRATION is the one written", dut.calibration.word == self.data)
        asked = dut.calibration.restart == (self.control & self.ones[4])
        bench.always("a restart is asked for by its bit", asked)
        return loaded & ~taken

    def errors(self) -> dict[str, Value]:
        """Flags: an event sets one, and a written 1 clears it, unless the event is in that clock."""
        m, bench = self.m, self.bench
        absent = Array(k not in self.kinds for k in range(WORDS))
        read_only = Array(self.kinds.get(k) == "ro" for k in range(WORDS))
        unmapped_read = bench.wire("unmapped_read", self.read & absent[self.read_word])
        unmapped_write = bench.wire("unmapped_write", self.write & absent[self.write_word])
        refused_write = bench.wire("refused_write", self.write & read_only[self.write_word])
        events = {name: signal for name, signal in self.inputs.items() if name in ERRORS}
        events["result_overrun"] = self.result & self.pending & ~self.cleared
        events["frame_suspect"] = self.result & self.inputs["validity"].any()
        events["access_refused"] = unmapped_read | unmapped_write | refused_write
        if self.identity.packets:
            events["results_lost"] = self.bench.probe("results.fifo.lost")
        word_refused = Const(0)
        if self.identity.calibration:
            word_refused = events["calibration_refused"] = self.calibration()
        errors = Signal(len(ERRORS))
        clear = Mux(self.writes("ERRORS"), self.ones, 0)
        m.d.sync += errors.eq((errors & ~clear) | Cat(events.get(name, 0) for name in ERRORS))
        bench.always("the register errors", bench.probe("errors", len(errors)) == errors)
        bench.always("an address without a register reads 0", ~unmapped_read | (self.read_data == 0))
        # OKAY, or if the scene asks for it, DECERR without a register and SLVERR for a refused write.
        responds = self.identity.bus_errors == "respond"
        decerr = Response.DECERR if responds else Response.OKAY
        slverr = Response.SLVERR if responds else Response.OKAY
        right_read = self.read_answer == Mux(unmapped_read, decerr, Response.OKAY)
        refused = Mux(refused_write | word_refused, slverr, Response.OKAY)
        right_write = self.write_answer == Mux(unmapped_write, decerr, refused)
        bench.always("a read's response", ~self.read | right_read)
        bench.always("a write's response", ~self.write | right_write)
        return {"ERRORS": errors}

    def constants(self) -> dict[str, Value]:
        """Registers that say which design this is."""
        identity = self.identity
        found = {
            "ID": ID,
            "VERSION": identity.version,
            "GEOMETRY": identity.height | identity.width << 16,
            "CAPABILITIES": identity.capabilities,
        }
        if not identity.calibration:
            found |= {
                "BUNDLE_HASH_LOW": identity.bundle_hash & 0xFFFFFFFF,
                "BUNDLE_HASH_HIGH": identity.bundle_hash >> 32,
            }
        return {name: Const(value, 32) for name, value in found.items()}

    def expected(self) -> dict[str, Value]:
        """What registers must read as, by their names."""
        return self.settings() | self.results() | self.slip() | self.errors() | self.constants()

    def read_as(self, expected: dict[str, Value]) -> None:
        """Assert that each of these registers reads as expected."""
        for name, value in expected.items():
            wrong = self.reads(name) & (self.read_data != value)
            self.bench.always(f"{name} reads as the register map says", ~wrong)


def registers(component: type, identity: Identity) -> FormalBench:
    """Every register reads, is written and answers as the register map says."""
    rules = Rules(component, identity)
    rules.read_as(rules.expected())
    return rules.bench


PROOFS = (
    Proof(
        "registers_full",
        RegisterBlock,
        "three axes of force, depth, normals, slip and background capture; errors are flagged",
        partial(registers, identity=FULL),
        depth=2,
        breaks=(
            ("(control & kept) | ones, control)", "ones, control)"),
            ("last_spread > limit", "last_spread >= limit"),
            ("(errors & ~clear_errors)", "(errors & ~ones)"),
            ("unwritable.eq(read_only)", "unwritable.eq(0)"),
            ("(pending & ~clear_pending) | result", "pending & ~clear_pending | result & ~pending"),
            ('read(f"FORCE_{axis.upper()}_LOW")', 'read(f"FORCE_{axis.upper()}_HIGH")'),
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
