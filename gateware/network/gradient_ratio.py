"""Surface normals to slopes, p = −n_x/n_z and q = −n_y/n_z, by pipelined non-restoring division."""

from amaranth import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import check_lanes, credit_handshake
from fastac.models.integer.network import GradientRatio


def check_ratio(ratio: GradientRatio) -> None:
    """Raise ValueError unless `ratio` can be divided bit by bit."""
    if ratio.normal_width < 2:
        raise ValueError(f"normal_width {ratio.normal_width}: expected at least 2")
    if not 0 <= ratio.fraction < ratio.width:
        raise ValueError(f"fraction {ratio.fraction}: expected 0 to {ratio.width - 1}")
    if ratio.width > ratio.normal_width + ratio.fraction:
        raise ValueError(
            f"width {ratio.width}: expected at most {ratio.normal_width + ratio.fraction},"
            " what the largest slope needs"
        )


class GradientDivider(wiring.Component):
    """Divide `lanes` normals per clock, bit-exact to `ratio` for every input, also n_z <= 0.

    Members
    -------
    i : stream of `lanes` normals (x, y, z), not necessarily unit vectors, signed(ratio.normal_width) each
    o : stream of `lanes` slopes (p, q), signed(ratio.width) each, of ratio.fraction fractional bits
    saturated : high while `o` offers a beat in which a slope saturates or an n_z is not positive
    over : one bit per slope of the offered beat (lane by lane, p then q): it saturates or its n_z is not
        positive

    The quotient Q = floor(2**(fraction+1)·|n| / n_z) has `ratio.width` bits and is rounded by (Q + 1) >> 1.
    Each stage brings down one bit of the numerator and finds one bit of Q, most significant first: it
    subtracts n_z, or adds it where the stage before has subtracted too much, and the bit is 1 where the
    remainder is not negative. As 2·(R + n_z) − n_z = 2·R + n_z, these are the bits of restoring division,
    with one addition a stage and no multiplexer. The remainder is in −n_z … n_z − 1; its sign is the last bit
    of Q, inverted, so it has normal_width − 1 bits beside. Q overflows if
    |n| >> (width − 1 − fraction) >= n_z, which is tested before the division.
    No register has a clock enable: beats that `o` does not take collect in a queue (`credit_handshake`).

    `latency` = ratio.width + 2 clocks (magnitudes, one stage per bit of Q, rounding) without back-pressure;
    initiation interval 1.
    """

    def __init__(self, ratio: GradientRatio, *, lanes: int):
        check_lanes(lanes)
        check_ratio(ratio)
        self.ratio, self.lanes = ratio, lanes
        normal = data.ArrayLayout(signed(ratio.normal_width), 3)
        slopes = data.ArrayLayout(signed(ratio.width), 2)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(normal, lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(slopes, lanes))),
                "saturated": Out(1),
                "over": Out(2 * lanes),
            }
        )

    @staticmethod
    def latency_of(width: int) -> int:
        """`latency` for slopes of `width` bits."""
        return width + 2

    @property
    def latency(self) -> int:
        return self.latency_of(self.ratio.width)

    def elaborate(self, platform):
        m = Module()
        last, _ = credit_handshake(m, self.i, self.o, self.latency, flags=self.over)

        flags = []
        for lane, normal in enumerate(self.i.payload):
            slopes, saturated = self._divide(m, normal, f"lane{lane}")
            m.d.comb += [last.payload[lane][k].eq(slope) for k, slope in enumerate(slopes)]
            flags += saturated
        m.d.comb += [last.flags.eq(Cat(flags)), self.saturated.eq(self.o.valid & self.over.any())]
        return m

    def _divide(self, m: Module, normal, lane: str) -> tuple[list[Signal], list[Signal]]:
        """Build one lane; returns its slopes and their saturation flags."""
        ratio = self.ratio
        whole = ratio.width - 1 - ratio.fraction  # integer bits of a slope = bits of |n| still to bring down
        remainder_width = ratio.normal_width - 1

        def register(value, name: str, shape=None) -> Signal:
            """`value` delayed by one register without a reset."""
            signal = Signal(value.shape() if shape is None else shape, reset_less=True, name=f"{lane}_{name}")
            m.d.sync += signal.eq(value)
            return signal

        n_z = normal[2]
        void = register(n_z <= 0, "void")
        # For n_z <= 0 divide by the largest divisor instead, so that a numerator of 0 gives 0.
        divisor = register(Mux(n_z <= 0, (1 << remainder_width) - 1, n_z), "divisor", remainder_width)
        axes = []
        for axis, n in zip("pq", normal, strict=False):
            negate = register(n >= 0, f"{axis}_negate")
            magnitude = register(Mux(n < 0, -n, n), f"{axis}_magnitude", ratio.normal_width)
            over = Mux(void, magnitude != 0, magnitude[whole:] >= divisor)
            # Initial remainder, then the bits still to bring down (zeros after those), and the quotient.
            axes.append((negate, over, magnitude[whole:], list(magnitude[:whole]), []))

        for k in range(ratio.width):
            more = k < ratio.width - 1  # nothing uses the last remainder
            for j, (axis, state) in enumerate(zip("pq", axes, strict=True)):
                negate, over, remainder, rest, quotient = state
                brought = Cat(rest.pop() if rest else Const(0, 1), remainder)
                subtract = quotient[0] if quotient else Const(1, 1)
                addend = Cat(divisor ^ subtract.replicate(remainder_width), subtract)
                # −D = ~D + 1; the lowest bits of the operands carry the 1.
                total = Cat(Const(1, 1), brought) + Cat(subtract, addend)
                trial = Signal(signed(remainder_width + 1), name=f"{lane}_{axis}_trial_{k}")
                m.d.comb += trial.eq(total[1:])
                fits = ~trial[-1]
                axes[j] = (
                    register(negate, f"{axis}_negate_{k}"),
                    register(over, f"{axis}_over_{k}"),
                    register(trial[:-1], f"{axis}_remainder_{k}") if more else None,
                    list(register(Cat(rest), f"{axis}_rest_{k}")) if rest else [],
                    list(register(Cat(fits, quotient), f"{axis}_quotient_{k}")),
                )
            void, divisor = register(void, f"void_{k}"), register(divisor, f"divisor_{k}") if more else None

        slopes, saturated = [], []
        for axis, (negate, over, _, _, quotient) in zip("pq", axes, strict=True):
            # ±((Q + 1) >> 1) with one adder: −a − b = ~a + (1 − b). Q of all ones would round past the limit.
            odd, half = quotient[0], Cat(bit ^ negate for bit in (*quotient[1:], 0))
            rounded = half.as_signed() + (odd ^ negate)
            beyond = over | Cat(quotient).all()
            limited = Mux(beyond, Mux(negate, -ratio.limit, ratio.limit), rounded)
            slopes.append(register(limited, axis, signed(ratio.width)))
            saturated.append(register(beyond | void, f"{axis}_saturated"))
        return slopes, saturated
