# amaranth: UnusedElaboratable=no
"""Proofs of the gradient ratios' non-restoring division: stage by stage, and exhaustively at small widths.

A stage brings one bit b of the numerator down to its remainder and finds one bit q of the quotient Q. With N
the bits brought down so far and D the divisor, it makes N' = 2·N + b and Q' = 2·Q + q. The bench keeps the
difference E = N - Q·D beside the stages, by its recursion E' = 2·E + b - q·D, so that no product of two
unknowns appears; z3 proves at the full width that after every stage 0 <= E < D, and that the remainder is E
or, where q is 0, E - D, which the next stage makes good. By that, Q after the last stage is floor(N/D), and
(Q + 1) >> 1 is N/(2·D) rounded to the nearest, halves up: what `models/integer/network.py` defines.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from amaranth import Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.hdl import ShapeLike
from amaranth.lib.memory import Memory

from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.models.integer.network import GradientRatio
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.exhaustive import Exhaustive, Trial
from fastac.sim.formal.proof import Proof

Register = Callable[..., Signal]
BITS, FORMS = 6, ((4, 0), (6, 5), (6, 2), (9, 3))
"""Bits of the normals that are all tried, and the formats of the slopes: (bits, fractional bits)."""


def stages(component: type, ratio: GradientRatio, axes: str = "pq") -> FormalBench:
    """After every stage R = E < D or R = E - D; the slope is the rounded quotient, limited, with its sign.

    axes : those whose stages are looked at
    """
    dut = component(ratio, lanes=1)
    bench = FormalBench(dut)
    bench.source(dut.i, "i")
    # That beats leave the queue unchanged is proven of the handshake (`pipelines`).
    bench.drive(dut.o.ready, bench.free("o_ready"))

    def register(value: Value, name: str, bits: ShapeLike = 1) -> Signal:
        """`value` a step of the pipeline later; no reset, as the pipeline's registers of data."""
        held = Signal(bits, name=name, reset_less=True)
        bench.m.d.sync += held.eq(value)
        return held

    n_z = dut.i.payload[0][2]
    bits = ratio.normal_width - 1
    live = [register(Const(1), "live")]  # the registers hold what the component has been given
    void = [register(n_z <= 0, "void")]
    divisor = [register(Mux(n_z <= 0, (1 << bits) - 1, n_z), "divisor", bits)]
    for name, own in (("divisor", divisor[0]), ("void", void[0])):
        bench.always(f"{name} of the input", ~live[0] | (bench.probe(f"lane0_{name}", len(own)) == own))
    bench.always("the divisor is positive", ~live[0] | (divisor[0] > 0))
    for k in range(ratio.width):
        live.append(register(live[-1], f"live_{k}"))
        void.append(register(void[-1], f"void_{k}"))
        divisor.append(register(divisor[-1], f"divisor_{k}", bits))
        bench.always(f"stage {k}: D > 0", ~live[-1] | (divisor[-1] > 0))
        if k < ratio.width - 1:
            own = bench.probe(f"lane0_divisor_{k}", bits)
            bench.always(f"stage {k}: D is the divisor", ~live[-1] | (own == divisor[-1]))
        own = bench.probe(f"lane0_void_{k}")
        bench.always(f"stage {k}: whether n_z is positive", ~live[-1] | (own == void[-1]))
    given = register(live[-1], "given")
    last = bench.probe("queue.i", 2 * ratio.width + 2)

    for axis in axes:
        place = "pq".index(axis)
        slope, saturated = _axis(bench, register, ratio, place, live, void, divisor)
        found = last.word_select(place, ratio.width)
        bench.always(f"{axis}: the slope is the rounded quotient", ~given | (found == slope))
        bench.always(f"{axis}: saturation is flagged", ~given | (last[2 * ratio.width + place] == saturated))
    bench.always("saturated while a slope of the beat is", dut.saturated == (dut.o.valid & dut.over.any()))
    return bench


def _axis(
    bench: FormalBench,
    register: Register,
    ratio: GradientRatio,
    place: int,
    live: list[Signal],
    void: list[Signal],
    divisor: list[Signal],
) -> tuple[Signal, Signal]:
    """Assert the invariant of one axis; returns the slope and the flag that must leave."""
    n, axis, bits = bench.dut.i.payload[0][place], "pq"[place], ratio.normal_width
    whole = ratio.width - 1 - ratio.fraction
    size = register(Mux(n < 0, -n, n), f"{axis}_size", bits)
    positive = register(n > 0, f"{axis}_positive")
    own = bench.probe(f"lane0_{axis}_magnitude", bits)
    bench.always(f"{axis}: magnitude of the input", ~live[0] | (own == size))
    own = bench.probe(f"lane0_{axis}_negate")
    bench.always(f"{axis}: sign of the input", ~live[0] | (size == 0) | (own == positive))
    exact, quotient = size >> whole, Const(0, 0)
    for k in range(ratio.width):
        fits = ~bench.probe(f"lane0_{axis}_trial_{k}", bits)[-1]
        brought = 2 * exact + (size[whole - 1 - k] if k < whole else 0)
        exact = register(brought - Mux(fits, divisor[k], 0), f"{axis}_exact_{k}", signed(bits + 2))
        quotient = register((quotient << 1) | fits, f"{axis}_quotient_{k}", k + 1)
        size = register(size, f"{axis}_size_{k}", bits)
        positive = register(positive, f"{axis}_positive_{k}")
        over = Mux(void[k + 1], size != 0, (size >> whole) >= divisor[k + 1])

        divides = live[k + 1] & ~over
        if k < ratio.width - 1:
            remainder = bench.probe(f"lane0_{axis}_remainder_{k}", bits - 1)
            lacking = exact - Mux(quotient[0], 0, divisor[k + 1])
            bench.always(f"{axis}, stage {k}: R = E", ~divides | (remainder == lacking[: bits - 1]))
        inside = (exact >= 0) & (exact < divisor[k + 1])
        bench.always(f"{axis}, stage {k}: 0 <= E < D", ~divides | inside)
        nothing = (quotient == 0) & (exact == 0)
        bench.always(f"{axis}, stage {k}: 0 / D = 0", ~divides | (size != 0) | nothing)

        own = bench.probe(f"lane0_{axis}_quotient_{k}", k + 1)
        bench.always(f"{axis}, stage {k}: Q is the quotient", ~live[k + 1] | (own == quotient))
        for name, value in (("over", over), ("negate", positive)):
            own = bench.probe(f"lane0_{axis}_{name}_{k}")
            known = (size == 0) if name == "negate" else Const(0)  # the sign of 0 does not matter
            bench.always(f"{axis}, stage {k}: {name}", ~live[k + 1] | known | (own == value))
        if k < whole - 1:
            own = bench.probe(f"lane0_{axis}_rest_{k}", whole - 1 - k)
            bench.always(f"{axis}, stage {k}: bits to come", ~live[k + 1] | (own == size[: len(own)]))

    rounded = (quotient + 1) >> 1
    beyond = over | (rounded > ratio.limit)
    limited = Mux(beyond, ratio.limit, rounded)
    slope = register(Mux(positive, -limited, limited), f"{axis}_slope", ratio.width)
    return slope, register(beyond | void[-1], f"{axis}_saturated")


EARLY = (
    ("fits = ~trial[-1]", "fits = trial > 0"),
    ("subtract = quotient[0] if", "subtract = Const(1, 1) if"),
    ("magnitude[whole:] >= divisor", "Const(0, 1)"),
)
LATE = (
    ("over | Cat(quotient).all()", "over"),
    ("(odd ^ negate)", "negate"),
    ("register(beyond | void,", "register(beyond,"),
)
"""Faults that show in the first stages, and those that show at the output only."""


class RatioTrial(Trial):
    """All normals of a few bits in dividers of several formats, against `models/integer/network.py`.

    The slopes p and q have their own stages and share n_z, so p runs through all n_x for every n_z and q
    through all n_y in another order.
    """

    def __init__(self, component: type):
        self.dividers = [component(GradientRatio(BITS, *form), lanes=1) for form in FORMS]
        super().__init__()

    def elaborate(self, platform):
        m = Module()
        given = Signal(2 * BITS + 1)
        m.d.sync += given.eq(given + ~given[-1])
        tried, wrong, ended = [], [], []
        for k, divider in enumerate(self.dividers):
            m.submodules[f"divider_{k}"] = divider
            normal = divider.i.payload[0]
            m.d.comb += [part.eq(value) for part, value in zip(normal, _normal(given), strict=True)]
            m.d.comb += [divider.i.valid.eq(~given[-1]), divider.o.ready.eq(1)]
            case = Signal(2 * BITS + 1, name=f"case_{k}")
            ended.append(case[-1])
            m.d.sync += case.eq(case + divider.o.valid)

            m.submodules[f"table_{k}"] = table = Memory(
                shape=unsigned(1 + divider.ratio.width), depth=1 << 2 * BITS, init=_slopes(divider.ratio)
            )
            *known, n_z = _normal(case)
            for place, n in enumerate(known):
                word = table.read_port(domain="comb")
                m.d.comb += word.addr.eq(Cat(n, n_z))
                found = Cat(divider.o.payload[0][place], divider.over[place])
                tried.append(divider.o.valid)
                wrong.append(found != word.data)
        m.d.sync += self.done.eq(Cat(ended).all())
        self.count(m, tried, wrong)
        return m


def _normal(case: Value) -> tuple[Value, Value, Value]:
    """n_x, n_y and n_z of a case; for every n_z both n_x and n_y take all values."""
    n_x, n_z = case[:BITS].as_signed(), case[BITS : 2 * BITS].as_signed()
    return n_x, (n_x + n_z)[:BITS].as_signed(), n_z


def _slopes(ratio: GradientRatio) -> list[int]:
    """By n + (n_z << BITS), both in two's complement: the slope, and above it whether it is flagged."""
    words = (np.arange(1 << BITS) ^ (1 << BITS >> 1)) - (1 << BITS >> 1)
    n_z, n = np.meshgrid(words, words, indexing="ij")
    slopes, saturated = ratio(np.stack([n, n, n_z], axis=-1))
    found = (slopes[..., 0] & ((1 << ratio.width) - 1)) | (saturated[..., 0] << ratio.width)
    return found.reshape(-1).tolist()


STAGES = tuple(
    Proof(
        f"gradient_divider_{normal_width}_{width}_{fraction}_{axes}",
        GradientDivider,
        f"normals of {normal_width} bits, slopes {axes} of {width} bits, {fraction} of them fractional; one"
        " lane, as lanes have nothing in common but the handshake, and axes nothing but the divisor",
        partial(stages, ratio=GradientRatio(normal_width, width, fraction), axes=axes),
        depth=2,
        breaks=breaks,
        broken_depth=width + 4 if breaks[-1] in LATE else 6,
        quick=width < 4,
    )
    for normal_width, width, fraction, axes, breaks in (
        (4, 3, 1, "pq", (*EARLY, *LATE)),
        (21, 17, 14, "p", EARLY[1:2]),
        (21, 17, 14, "q", EARLY[1:2]),
    )
)

PROOFS = (
    *STAGES,
    Exhaustive(
        "gradient_divider_all",
        GradientDivider,
        f"all normals of {BITS} bits in formats of (bits, fractional bits) {', '.join(map(str, FORMS))}",
        "slopes and flags with the integer model",
        RatioTrial,
        cases=len(FORMS) * 2 << 2 * BITS,
        clocks=(1 << 2 * BITS) + 64,
        breaks=(EARLY[-1], LATE[0]),
    ),
)
