"""Proof of the AXI4-Lite slave, by the rules of Arm IHI 0022: each access once, its own answer."""

from amaranth import Cat, Signal, Value

from fastac.gateware.bus.axi_lite import AxiLiteSlave
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof

ADDRESS_WIDTH = 4


def axi_lite(component: type) -> FormalBench:
    """The master keeps the rules of the three channels that it drives; the registers answer as they like."""
    bench = FormalBench(component(ADDRESS_WIDTH))
    m, axil, bus = bench.m, bench.dut.axil, bench.dut.bus

    def channel(name: str, *payload: str) -> tuple[Signal, Signal]:
        """A request channel of the master: (a request waits for its access, its payload)."""
        valid = bench.free(f"{name}valid")
        bench.drive(getattr(axil, f"{name}valid"), valid)
        signals = [bench.free(member, len(getattr(axil, member))) for member in payload]
        for member, signal in zip(payload, signals, strict=True):
            bench.drive(getattr(axil, member), signal)
        ready = getattr(axil, f"{name}ready")
        bench.assume(bench.held(name, valid, ready, Cat(*signals))[1])
        pending = Signal(name=f"{name}_pending")
        kept = Signal(len(Cat(*signals)), name=f"{name}_kept")
        done = bus.read if name == "ar" else bus.write
        with m.If(valid & ready):
            m.d.sync += [pending.eq(1), kept.eq(Cat(*signals))]
        with m.Elif(done):
            m.d.sync += pending.eq(0)
        bench.always(f"{name}ready: a request is taken when none waits", ready == ~pending)
        return pending, kept

    address, to = channel("aw", "awaddr")
    data, word = channel("w", "wdata", "wstrb")
    request, of = channel("ar", "araddr")
    for name in ("read_data", "read_response", "write_response"):
        member = getattr(bus, name)
        bench.drive(member, bench.free(name, len(Value.cast(member))))

    def answer(name: str, access: Signal, *given: tuple[str, Signal]) -> Signal:
        """A response channel, which must hold the answer of its access; returns whether one is open."""
        valid, ready = getattr(axil, f"{name}valid"), bench.free(f"{name}ready")
        bench.drive(getattr(axil, f"{name}ready"), ready)
        shown = Cat(getattr(axil, member) for member, _ in given)
        rule = bench.held(name, valid, ready, shown)[1]
        bench.always(f"{name}valid holds and its payload is stable until it is taken", rule)
        unanswered = Signal(name=f"{name}_open")
        expected = Signal(len(shown), name=f"{name}_expected")
        with m.If(access):
            m.d.sync += [unanswered.eq(1), expected.eq(Cat(value for _, value in given))]
        with m.Elif(valid & ready):
            m.d.sync += unanswered.eq(0)
        bench.always(f"{name}: one answer for each access", valid == unanswered)
        bench.always(f"{name}: the answer of the registers", ~valid | (shown == expected))
        bench.always(f"{name}: no access while an answer is open", ~(access & unanswered))
        return unanswered

    written = answer("b", bus.write, ("bresp", bus.write_response))
    read = answer("r", bus.read, ("rdata", bus.read_data), ("rresp", bus.read_response))
    bench.always("no deadlock: a write happens when asked for", bus.write == (address & data & ~written))
    bench.always("no deadlock: a read happens when asked for", bus.read == (request & ~read))
    bench.always("a write's own address", ~bus.write | (bus.write_word == to[2:]))
    mask = Cat(bit.replicate(8) for bit in word[32:])
    bench.always("a write's own data", ~bus.write | (bus.write_data == word[:32]))
    bench.always("a write's own strobes", ~bus.write | (bus.write_mask == mask))
    bench.always("a read's own address", ~bus.read | (bus.read_word == of[2:]))
    for name, pending, kept in (("aw", address, to), ("ar", request, of)):
        inner = bench.probe(f"axil__{name}addr_held", ADDRESS_WIDTH)
        bench.always(f"{name}: the slave keeps the address", ~pending | (inner == kept))
    inner = Cat(bench.probe("axil__wdata_held", 32), bench.probe("axil__wstrb_held", 4))
    bench.always("w: the slave keeps the data", ~data | (inner == word))
    return bench


PROOFS = (
    Proof(
        "axi_lite",
        AxiLiteSlave,
        f"addresses of {ADDRESS_WIDTH} bits, which are only stored",
        axi_lite,
        depth=2,
        breaks=(
            ("aw_held & w_held & ~axil.bvalid", "aw_held & w_held"),
            ("ar_held & ~axil.rvalid", "ar_held"),
            ("with m.Elif(axil.bready):", "with m.Else():"),
            ("bit.replicate(8) for bit in write_strobe", "bit.replicate(8) for bit in write_strobe[::-1]"),
            ("axil.rdata.eq(bus.read_data)", "axil.rdata.eq(bus.read_data & bus.write_mask)"),
            (
                'm.d.comb += getattr(axil, f"{channel}ready").eq(~held)',
                'm.d.comb += getattr(axil, f"{channel}ready").eq(1)',
            ),
        ),
        quick=True,
    ),
)
