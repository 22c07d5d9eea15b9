"""The spread of shifts about the rigid motion that fits them, from the sums over the dots in contact."""

from amaranth import Cat, Module, Mux, Signal, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.slip.product_sum import ProductSum
from fastac.gateware.slip.rigid_sums import sums_layout
from fastac.models.integer.dot_spread import LEAST_DOTS, DotSpread
from fastac.models.integer.words import signed_width


def spread_layout(spread: DotSpread) -> data.StructLayout:
    """The spread in px² · 2**(2 · FRACTION), and the number of dots in contact."""
    bounds = spread.bounds
    return data.StructLayout(
        {"spread": unsigned(bounds["spread"].bit_length()), "dots": unsigned(bounds["n"].bit_length())}
    )


class SpreadRatio(wiring.Component):
    """(A C − B²) / (n² C) of `DotSpread`, rounded down: products and quotient a bit a clock, once a frame.

    Members
    -------
    i : stream of one beat per frame, see `sums_layout`
    o : stream of one beat per frame, see `spread_layout`; the spread is 0 for fewer than LEAST_DOTS dots

    `latency` = the bits of the factors of four products in a row and of the quotient, and 5 clocks. The sums
    stay at `i` until the spread is found.
    """

    multipliers = 0

    def __init__(self, spread: DotSpread):
        self.spread = spread
        super().__init__(
            {
                "i": In(stream.Signature(sums_layout(spread))),
                "o": Out(stream.Signature(spread_layout(spread))),
            }
        )

    @staticmethod
    def phases_of(spread: DotSpread) -> tuple[int, ...]:
        """Bits of the largest factor of each of the products in a row."""
        bounds = spread.bounds
        of_count = bounds["n"].bit_length()
        first = max(bounds[name].bit_length() for name in ("u", "v", "x", "y"))
        last = max(bounds["C"].bit_length(), bounds["B"].bit_length(), 2 * of_count)
        return of_count, first, first, last

    @classmethod
    def latency_of(cls, spread: DotSpread) -> int:
        phases = cls.phases_of(spread)
        return sum(phases) + len(phases) + spread.bounds["spread"].bit_length() + 1

    @property
    def latency(self) -> int:
        return self.latency_of(self.spread)

    @property
    def interval(self) -> int:
        return self.latency + 1

    def elaborate(self, platform):
        m = Module()
        bounds, phases = self.spread.bounds, self.phases_of(self.spread)
        sums, out = self.i.payload, self.o.payload
        most = {name: bound.bit_length() for name, bound in bounds.items()}
        sides = max(most["x"], most["y"])
        b_bits = signed_width(bounds["B"])
        count_bits, quotient_bits = len(sums.n), len(out.spread)
        # Of A and then A C; of B and then B²; of C and then n² C; of n². Only B may be negative.
        ends = [bounds["A"] * bounds["C"], bounds["B"] ** 2, bounds["C"] * bounds["n"] ** 2]
        a_bits, square_bits, c_bits = (end.bit_length() for end in ends)
        a_factor = max(most["n"], most["u"], most["v"], most["C"])
        b_factor = max(most["n"], sides, most["B"])
        c_factor = max(sides, 2 * most["n"])
        a = ProductSum("a", a_bits, factor_bits=a_factor)
        b = ProductSum("b", max(square_bits, b_bits), factor_bits=b_factor)
        c = ProductSum("c", c_bits, factor_bits=c_factor)
        n = ProductSum("n", 2 * count_bits, factor_bits=most["n"], only_adds=True)
        every = (a, b, c, n)
        n_, u, v, x, y = sums.n, sums.u, sums.v, sums.x, sums.y
        of_a, of_b, of_c = a.total[: most["A"]], b.total[:b_bits].as_signed(), c.total[: most["C"]]
        loads = (
            [
                *a.load(sums.square, n_, afresh=True),
                *b.load(sums.turn, n_, afresh=True),
                *c.load(sums.far, n_, afresh=True),
                *n.load(n_, n_, afresh=True),
            ],
            [*a.load(u, u, minus=True), *b.load(v, x, minus=True), *c.load(x, x, minus=True)],
            [*a.load(v, v, minus=True), *b.load(u, y), *c.load(y, y, minus=True)],
            [
                *a.load(of_a, of_c, afresh=True),
                *b.load(of_b, of_b, afresh=True),
                *c.load(of_c, n.total, afresh=True),
            ],
        )
        phase = Signal(range(len(phases)))
        step = Signal(range(max(*phases, quotient_bits)))  # counts down to 0
        divisor = c.total  # more than 0, or of too few dots
        remainder = Signal(len(divisor), reset_less=True)
        rest = Signal(quotient_bits, reset_less=True)
        left = (a.total - b.total)[: len(a.total)]
        brought = Cat(rest[-1], remainder)
        fits = brought >= divisor
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.FSM():
            for k, (bits, load) in enumerate(zip(phases, loads, strict=True)):
                with m.State(f"LOAD {k}"):
                    begin = (self.i.valid & ~self.o.valid) if k == 0 else 1
                    with m.If(begin):
                        # A product that has none in this phase goes on with the factor 0, to which it came.
                        m.d.sync += [*load, step.eq(bits - 1), phase.eq(k)]
                        m.next = "MULTIPLY"
            with m.State("MULTIPLY"):
                m.d.sync += [*(s for product in every for s in product.step()), step.eq(step - 1)]
                with m.If(step == 0), m.Switch(phase):
                    for k in range(len(phases)):
                        with m.Case(k):
                            m.next = f"LOAD {k + 1}" if k + 1 < len(phases) else "SUBTRACT"
            with m.State("SUBTRACT"):
                # The quotient has no more bits than `rest`, so the upper ones are less than the divisor.
                m.d.sync += [
                    rest.eq(left[:quotient_bits]),
                    remainder.eq(left[quotient_bits:]),
                    step.eq(quotient_bits - 1),
                    out.dots.eq(n_),
                ]
                m.next = "DIVIDE"
            with m.State("DIVIDE"):
                m.d.sync += [
                    remainder.eq(Mux(fits, brought - divisor, brought)),
                    rest.eq(rest << 1),
                    out.spread.eq(Mux(n_ < LEAST_DOTS, 0, Cat(fits, out.spread))),
                    step.eq(step - 1),
                ]
                with m.If(step == 0):
                    m.d.comb += self.i.ready.eq(1)
                    m.d.sync += self.o.valid.eq(1)
                    m.next = "LOAD 0"
        return m
