"""Surface normals to slopes with few subtractors: both slopes of a normal every `fold` clocks."""

from amaranth import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.network.gradient_ratio import check_ratio
from fastac.gateware.stream.handshake import check_folded, credit_handshake
from fastac.models.integer.network import GradientRatio


class FoldedDivider(wiring.Component):
    """Divide a normal every `fold` clocks, bit-exact to `ratio` for every input, as GradientDivider does.

    Members
    -------
    i : stream of normals (x, y, z), not necessarily unit vectors, signed(ratio.normal_width) each; a beat at
        most every `fold` clocks
    o : stream of slopes (p, q), signed(ratio.width) each, of ratio.fraction fractional bits
    saturated : high while `o` offers a beat in which a slope saturates or its n_z is not positive
    over : one bit per slope of the offered beat, p then q: it saturates or its n_z is not positive

    Non-restoring division: each step adds the divisor to the remainder or subtracts it, whichever brings it
    nearer to 0, and finds one bit of Q = floor(2**(fraction+1)·|n| / n_z), which is rounded by (Q + 1) >> 1.
    A step before the `ratio.width` bits of Q finds whether it overflows. A unit has one adder and makes
    fold/2 steps, first of p, then of q; ceil((width + 1) / (fold/2)) units in a row make all of them.
    Beats that `o` does not take collect in a queue (`credit_handshake`).

    `latency` = ratio.width + 3 + fold/2 clocks without back-pressure; `interval` = fold.
    """

    lanes = 1

    def __init__(self, ratio: GradientRatio, *, fold: int):
        check_folded(fold)
        check_ratio(ratio)
        self.ratio, self.fold, self.interval = ratio, fold, fold
        normal = data.ArrayLayout(signed(ratio.normal_width), 3)
        slopes = data.ArrayLayout(signed(ratio.width), 2)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(normal, 1))),
                "o": Out(stream.Signature(data.ArrayLayout(slopes, 1))),
                "saturated": Out(1),
                "over": Out(2),
            }
        )

    @staticmethod
    def latency_of(width: int, fold: int) -> int:
        """`latency` for slopes of `width` bits."""
        return width + 3 + fold // 2

    @property
    def latency(self) -> int:
        return self.latency_of(self.ratio.width, self.fold)

    def elaborate(self, platform):
        m = Module()
        ratio, turn = self.ratio, self.fold // 2  # clocks of a slope in a unit
        steps = ratio.width + 1
        last, ago = credit_handshake(m, self.i, self.o, self.latency, fold=self.fold, flags=self.over)

        def register(value, name: str, enable: Value | int = 1, shape=None) -> Signal:
            """`value` a clock later, kept while `enable` is low."""
            signal = Signal(value.shape() if shape is None else shape, reset_less=True, name=name)
            with m.If(enable):
                m.d.sync += signal.eq(value)
            return signal

        # p is taken from the input at once, q when p leaves the first unit.
        n_x, n_y, n_z = self.i.payload[0]
        kept = register(n_y, "kept", ago[0])
        n = Signal(signed(ratio.normal_width))
        m.d.comb += n.eq(Mux(ago[turn], kept, n_x))
        magnitude = Signal(ratio.normal_width)
        m.d.comb += magnitude.eq(Mux(n < 0, -n, n))
        # In the first step all bits but `whole` are brought down, then one of these in each, then zeros.
        whole = ratio.width - 1 - ratio.fraction
        brought = whole + 1
        remainder, rest = magnitude[brought:], list(magnitude[:brought])
        # What goes with a slope: whether it is negative, whether it is 0, and whether n_z is positive.
        void = register(n_z <= 0, "void_kept", ago[0])
        marks = Cat(n >= 0, n.any(), Mux(ago[turn], void, n_z <= 0))
        divisor, found = n_z[: ratio.normal_width - 1], []

        for unit, start in enumerate(range(0, steps, turn)):
            own = min(turn, steps - start)
            enters = ago[start] | ago[start + turn]
            divisor = register(divisor, f"divisor_{unit}", ago[0] if unit == 0 else enters)
            marks = register(marks, f"marks_{unit}", enters)
            # The bits of Q that earlier units have found, and this one before the present step, newest first.
            older = list(register(Cat(found), f"found_{unit}", enters)) if found else []
            newer = []
            held = Signal(signed(ratio.normal_width), name=f"remainder_{unit}", reset_less=True)
            brings = [Signal(name=f"rest_{unit}_{k}", reset_less=True) for k in range(brought - start)]
            # 2·remainder ± divisor. To subtract is to add all bits inverted, and 1: the carry of 1 + 1 below.
            positive = ~held[-1]
            doubled = Cat(Const(1, 1), brings[-1:] or Const(0, 1), held[:-1])
            term = Cat(positive, divisor ^ positive.replicate(len(divisor)), positive)
            total = Signal(signed(ratio.normal_width), name=f"total_{unit}")
            m.d.comb += total.eq((doubled + term)[1:])
            bit = ~total[-1]
            for k in range(own - 1):
                newer.append(register(newer[-1] if newer else bit, f"newer_{unit}_{k}"))
            following = [Const(0, 1), *brings[:-1]][: len(brings)]
            if own > 1:
                m.d.sync += [held.eq(total), *map(Signal.eq, brings, following)]
            with m.If(enters):
                entering = rest[len(rest) - len(brings) :]
                m.d.sync += [held.eq(remainder), *map(Signal.eq, brings, entering)]
            remainder, rest, found = total, following, [bit, *newer, *older]

        done = ago[steps] | ago[steps + turn]
        quotient, marks = register(Cat(found), "quotient", done), register(marks, "marks_done", done)
        negate, some, void = marks
        quotient, overflow = quotient[:-1], quotient[-1]
        # ±((Q + 1) >> 1) with one adder: −a − b = ~a + (1 − b). Q of all ones would round past the limit.
        odd, half = quotient[0], Cat(bit ^ negate for bit in (*quotient[1:], 0))
        rounded = half.as_signed() + (odd ^ negate)
        beyond = Mux(void, some, overflow | quotient.all())
        limited = Mux(beyond, Mux(negate, -ratio.limit, ratio.limit), rounded)
        slope = Mux(void & ~some, 0, limited)
        for k in range(2):
            due = ago[steps + 1 + k * turn]
            m.d.comb += [
                last.payload[0][k].eq(register(slope, "pq"[k], due, signed(ratio.width))),
                last.flags[k].eq(register(beyond | void, f"{'pq'[k]}_saturated", due)),
            ]
        m.d.comb += self.saturated.eq(self.o.valid & self.over.any())
        return m
