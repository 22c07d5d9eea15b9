# amaranth: UnusedElaboratable=no
"""Proofs of slip: which dots touch, the sums over them, and their ratio; its values by trying all of them."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from amaranth import Array, Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data

from fastac.gateware.slip.contact import DotContact
from fastac.gateware.slip.rigid_sums import KEPT_FRAMES, RigidSums, sums_layout
from fastac.gateware.slip.spread_ratio import SpreadRatio
from fastac.models.integer.dot_spread import LEAST_DOTS, DotSpread
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.exhaustive import Exhaustive, Trial
from fastac.sim.formal.frame_order import FrameCounter
from fastac.sim.formal.proof import Proof

ROWS, WORD, THRESHOLD = 3, signed(2), 0
PLACES = np.array([(0, 0), (1, 1), (0, 2)])
"""Column and row of dots; one is in a frame's first beat, whichever row comes first."""
FRAMES = 4 * KEPT_FRAMES
"""Frames that are told apart; fewer are ever inside."""


def dot_contact(component: type, lanes: int, rows_reversed: bool) -> FormalBench:
    """A frame's contact has a bit for each dot, of the displacement at its own place."""
    spread = DotSpread(PLACES, THRESHOLD, 1)
    dut = component(spread, WORD, rows=ROWS, lanes=lanes, rows_reversed=rows_reversed)
    bench = FormalBench(dut)
    m, beats = bench.m, ROWS * -(-ROWS // lanes)
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    entered = FrameCounter(bench, "in", enters, beats)
    row = [ROWS - 1 - r if rows_reversed else r for r in PLACES[:, 1]]
    at = [(r * -(-ROWS // lanes) + c // lanes, c % lanes) for (c, _), r in zip(PLACES, row, strict=True)]
    own = sorted((int(beat), int(lane)) for beat, lane in at)  # as they come by
    touches = [Signal(name=f"touches_{k}", reset_less=True) for k in range(len(own))]
    for (beat, lane), caught in zip(own, touches, strict=True):
        with m.If(enters & (entered.place == beat)):
            m.d.sync += caught.eq(dut.i.payload[lane] > THRESHOLD)
    due = Signal()  # a whole frame has entered, and its contact has not left
    m.d.sync += due.eq((due & ~leaves) | (enters & (entered.place == beats - 1)))
    bench.always("a contact for each frame, a clock after its last beat", dut.o.valid == due)
    bench.always("the contact of the frame's own dots", ~due | (dut.o.payload == Cat(touches)))
    bench.always("no deadlock: waits for an untaken contact only", dut.i.ready == (dut.o.ready | ~due))

    bench.always("the beat in its frame", bench.probe("beat", range(beats)) == entered.place)
    index = bench.probe("table__addr", range(len(own) + 1))
    passed = ones(entered.place > beat for beat, _ in own)
    bench.always("the dots that have passed", index == passed)
    for count in range(1, len(own) + 1):
        bits = dut.o.payload[-count:]
        bench.always(f"the bits of {count} dots", (index != count) | (bits == Cat(touches[:count])))
    return bench


@dataclass
class Width:
    """What sums need to know of a `DotFollower`."""

    width: int


def rigid_sums(component: type) -> FormalBench:
    """Sums k are those of the k-th frame's dots that touch by the k-th contact, and no dots are overwritten.

    A free constant chooses a frame, whose dots and contact are caught as they enter.
    """
    spread, count = DotSpread(np.array([(0, 0), (1, 2)]), 0, 1), 2
    order = np.array([1, 0])
    dut = component(spread, Width(2), order)
    bench = FormalBench(dut)
    m, o = bench.m, dut.o.payload
    chosen = bench.constant("chosen", range(FRAMES))
    dot_enters, dot = bench.source(dut.dots, "dots")
    begins, contact = bench.source(dut.contact, "contact")
    leaves = bench.sink(dut.o, "o")
    dots = dut.dots.payload.shape()

    def bounded(word: Value) -> Value:
        """The sums are as wide as needed for shifts within the follower's bound."""
        view = data.View(dots, word)
        return (view.u >= -spread.shift_limit) & (view.v >= -spread.shift_limit)

    bench.assume(bounded(dot))

    place, into, walked, left = (
        Signal(range(n), name=name)
        for n, name in ((count, "place"), (FRAMES, "into"), (FRAMES, "walked"), (FRAMES, "left"))
    )
    words = [Signal(len(dot), name=f"dot_{k}", reset_less=True) for k in range(count)]
    touching = Signal(count, reset_less=True)
    with m.If(dot_enters):
        last = place == count - 1
        m.d.sync += [place.eq(Mux(last, 0, place + 1)), into.eq(into + last)]
        with m.If(into == chosen):
            m.d.sync += Array(words)[place].eq(dot)
    phase = Signal(range(dut.latency))  # clocks since a contact was taken; 0: none is under way
    with m.If(begins | (phase != 0)):
        m.d.sync += phase.eq(Mux(phase == dut.latency - 1, 0, phase + 1))
    begun = Signal(range(FRAMES))  # frames whose contact has been taken
    m.d.sync += begun.eq(begun + begins)
    with m.If(begins & (begun == chosen)):
        m.d.sync += touching.eq(contact)
    done = phase == count
    m.d.sync += [walked.eq(walked + done), left.eq(left + leaves)]
    walks = (phase >= 1) & (phase <= count)

    def modulo(value: Value) -> Value:
        return value[: len(begun)]

    # Where the hardware is.
    whole = bench.probe("whole", range(KEPT_FRAMES + 1))
    bank = (KEPT_FRAMES - 1).bit_length()
    bench.always("the place of the next dot", bench.probe("come", range(count)) == place)
    bench.always("the bank that is written", bench.probe("into", bank) == into[:bank])
    bench.always("the bank that is read", bench.probe("out_of", bank) == walked[:bank])
    bench.always("frames kept", whole == modulo(into - walked))
    bench.always("no more frames than are kept", whole <= KEPT_FRAMES)
    bench.always("nothing of a frame without a place", (whole != KEPT_FRAMES) | (place == 0))
    bench.always("a frame's dots are there when they are read", ~walks | (whole != 0))
    bench.always("walks over the dots", bench.probe("walking") == walks)
    index = bench.probe("table__addr", range(count))
    bench.always("the dot that is read", ~walks | (index == (phase - 1)[: len(index)]))
    flow = bench.probe("flow", dut.latency - count - 1)
    way = Cat(phase == count + 1 + k for k in range(len(flow)))
    bench.always("the last dot's way", flow == way)
    bits = bench.probe("bits", count)
    mine = walks & (modulo(begun - 1) == chosen)
    bench.always("contacts to come", ~mine | (bits == touching >> (phase - 1)[: len(index)]))
    bench.always("no contact is left", walks | (bits == 0))
    bench.always("contacts taken", modulo(begun - walked) == ((phase != 0) & (phase <= count)))
    inside = modulo(begun - left)
    bench.always("sums under way or offered", inside == ((phase != 0) | dut.o.valid))
    bench.always("sums are offered when they are whole", ~dut.o.valid | (phase == 0))
    kept = modulo(into - chosen) < FRAMES >> 1  # the chosen frame has entered
    unread = modulo(chosen - walked) < KEPT_FRAMES
    for k, word in enumerate(words):
        rows = [bench.probe(f"kept[{2 * b + k}]", len(dot)) for b in range(KEPT_FRAMES)]
        entered = (kept & (into != chosen)) | ((into == chosen) & (place > k))
        stored = Array(rows)[chosen[:bank]] == word
        bench.always(f"dot {k} is kept until it is read", ~(entered & unread) | stored)
        bench.always(f"dot {k} is within the bound", bounded(word))

    # What leaves.
    found = {name: Const(0, signed(6)) for name in o.shape().members}
    for k, j in enumerate(order.tolist()):
        values = data.View(dots, words[j])
        counts = touching[k] & values.seen
        u, v, (x, y) = values.u, values.v, spread.xy[j].tolist()
        terms = {"n": 1, "u": u, "v": v, "x": x, "y": y}
        terms |= {"square": u * u + v * v, "turn": x * v - y * u, "far": x * x + y * y}
        found = {name: total + Mux(counts, terms[name], 0) for name, total in found.items()}
    offered = dut.o.valid & (left == chosen)
    for name, total in found.items():
        bench.always(f"{name}: of the frame's own dots", ~offered | (o[name] == total))
    free = (phase == 0) & ~dut.o.valid
    bench.always(
        "no deadlock: a contact is taken when its dots are there",
        dut.contact.ready == (dut.contact.valid & (whole != 0) & free),
    )
    bench.always("no deadlock: dots wait for room only", dut.dots.ready == (whole != KEPT_FRAMES))
    ended = bench.past(phase == dut.latency - 1, "ended")
    bench.always("no deadlock: offered after the clocks that are stated", ~ended | dut.o.valid)
    return bench


def spread_ratio(component: type) -> FormalBench:
    """A spread for each sums, after as many clocks as stated, with their number of dots."""
    spread = DotSpread(np.array([(0, 0), (1, 0), (0, 1)]), 0, 1)
    dut = component(spread)
    bench = FormalBench(dut)
    m, o = bench.m, dut.o.payload
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    due = Signal()
    m.d.sync += due.eq((due & ~leaves) | enters)
    count = Signal(len(dut.i.payload.n), reset_less=True)
    with m.If(enters):
        m.d.sync += count.eq(dut.i.payload.n)
    bench.always("a spread for each sums", dut.o.valid == due)
    bench.always("the sums' number of dots", ~due | (o.dots == count))
    bench.always("too few dots have no spread", ~due | (count >= LEAST_DOTS) | (o.spread == 0))

    clocks = Signal(range(dut.latency))  # that the sums at the input have been worked on
    works = dut.i.valid & ~dut.o.valid
    m.d.sync += clocks.eq(Mux(works & ~enters, clocks + 1, 0))
    bench.always("no deadlock: taken after the clocks that are stated", enters == (clocks == dut.latency - 1))
    bench.always("works while there are sums", (clocks == 0) | (works & (clocks < dut.latency)))

    # For the induction: the state that belongs to each clock.
    phases, quotient = dut.phases_of(spread), len(o.spread)
    state = bench.probe("fsm_state", range(len(phases) + 3))
    step = bench.probe("step", range(max(*phases, quotient)))
    phase = bench.probe("phase", range(len(phases)))

    def during(first: int, length: int) -> Value:
        """Whether the clock is one of `length` from `first`."""
        return (clocks >= first) & (clocks < first + length)

    at, loads, multiplies = 0, [], []
    for k, bits in enumerate(phases):
        loads.append(during(at, 1))
        multiplies.append(during(at + 1, bits))
        bench.always(f"phase {k}", ~multiplies[-1] | (phase == k))
        bench.always(f"phase {k}: the step", ~multiplies[-1] | (step == (at + bits - clocks)[: len(step)]))
        at += 1 + bits
    first = at + 1
    dividing = during(first, quotient)
    bench.always("division: the step", ~dividing | (step == (at + quotient - clocks)[: len(step)]))
    # The hardware's states in the order in which they are named.
    names = ["load 0", "multiply", *(f"load {k}" for k in range(1, len(phases))), "subtract", "divide"]
    states = [loads[0], Cat(multiplies).any(), *loads[1:], during(at, 1), dividing]
    for k, (name, here) in enumerate(zip(names, states, strict=True)):
        bench.always(f"state {name} in its clocks", (state == k) == here)
    bench.always("the dots while it divides", ~dividing | (o.dots == dut.i.payload.n))
    few = dut.i.payload.n < LEAST_DOTS
    bench.always("nothing so far of too few dots", ~((clocks > first) & few) | (o.spread == 0))
    return bench


class RatioTrial(Trial):
    """All contacts of a few dots and all shifts of some values, with the definition by products alone.

    A case is a number: a bit for each dot's contact, and above it `bits` for each of its shifts.
    """

    def __init__(self, component: type, spread: DotSpread, bits: int):
        self.spread, self.bits, self.ratio = spread, bits, component(spread)
        super().__init__()

    def elaborate(self, platform):
        m, dots, bits = Module(), len(self.spread.place), self.bits
        m.submodules.ratio = ratio = self.ratio
        total = dots * (1 + 2 * bits)
        given = Signal(total + 1)
        sums = {name: Const(0, 1) for name in sums_layout(self.spread).members}
        limit = self.spread.shift_limit
        for k, (x, y) in enumerate(self.spread.xy.tolist()):
            word = given[dots + 2 * k * bits :]
            u, v = (_shift(part, limit) for part in (word[:bits], word[bits : 2 * bits]))
            terms = {"n": Const(1), "u": u, "v": v, "x": Const(x), "y": Const(y)}
            terms |= {"square": u * u + v * v, "turn": x * v - y * u, "far": Const(x * x + y * y)}
            sums = {name: value + Mux(given[k], terms[name], 0) for name, value in sums.items()}
        m.d.comb += [
            *(ratio.i.payload[name].eq(value) for name, value in sums.items()),
            ratio.i.valid.eq(~given[-1]),
            ratio.o.ready.eq(1),
        ]
        with m.If(ratio.i.ready & ratio.i.valid):
            m.d.sync += given.eq(given + 1)
        bounds = self.spread.bounds
        n = Signal(len(ratio.i.payload.n))
        rest, divisor = (
            Signal(signed(2 + (bounds["A"] * bounds["C"]).bit_length()), name=name)
            for name in ("rest", "divisor")
        )
        u, v, x, y = (sums[name] for name in "uvxy")
        a = sums["n"] * sums["square"] - u * u - v * v
        b = sums["n"] * sums["turn"] - x * v + y * u
        c = sums["n"] * sums["far"] - x * x - y * y
        with m.If(ratio.i.ready & ratio.i.valid):
            m.d.sync += [
                n.eq(sums["n"]),
                rest.eq(a * c - b * b),
                divisor.eq(sums["n"] * sums["n"] * c),
            ]
        found = ratio.o.payload
        product = found.spread * divisor
        right = Mux(n < LEAST_DOTS, found.spread == 0, (product <= rest) & (rest < product + divisor))
        m.d.sync += self.done.eq(given[-1])
        self.count(m, [ratio.o.valid], [~right | (found.dots != n)])
        return m


def _shift(word: Value, limit: int) -> Value:
    """A word of a few bits as a shift: all magnitudes with one bit, else in two's complement."""
    return Mux(word, limit, -limit) if len(word) == 1 else word.as_signed()


def trial(component: type, places: list, limit: int, bits: int) -> RatioTrial:
    return RatioTrial(component, DotSpread(np.array(places), 0, limit), bits)


THREE = ([(0, 0), (3, 1), (1, 2)], 2, 2)
FIVE = ([(0, 0), (4, 0), (0, 3), (5, 5), (2, 2)], 3, 1)

PROOFS = (
    *(
        Proof(
            f"dot_contact_{lanes}",
            DotContact,
            f"3 × 3 displacements of 2 bits, {lanes} a beat, three dots; places are compared with a table",
            partial(dot_contact, lanes=lanes, rows_reversed=rows_reversed),
            depth=2,
            breaks=(
                ("taken & (beat == place.beat)", "self.i.valid & (beat == place.beat)"),
                ("displacement > self", "displacement >= self"),
                ("self.i.ready.eq(~self.o.valid | self.o.ready)", "self.i.ready.eq(1)"),
                ("index.eq(0)]", "index.eq(index)]"),
                ("Cat(self.o.payload[1:], touches)", "Cat(touches, self.o.payload[:-1])"),
                ("Mux(last, 0, beat + 1)", "beat + 1"),
            ),
            quick=lanes == 2,
        )
        for lanes, rows_reversed in ((1, False), (2, True))
    ),
    Proof(
        "rigid_sums",
        RigidSums,
        "two dots with shifts of -1, 0 and 1: dots are read one by one, and sums only add up",
        rigid_sums,
        depth=10,
        breaks=(
            ("room.eq(whole != KEPT_FRAMES)", "room.eq(1)"),
            ("self.contact.valid & (whole != 0) &", "self.contact.valid &"),
            ("& ~flow.any() & ~self.o.valid", "& ~flow.any()"),
            ("touches & dot.seen", "touches"),
            ("bits.eq(bits >> 1)", "bits.eq(bits)"),
            ("sums.turn + xv - yu", "sums.turn + xv + yu"),
            ("out_of.eq(out_of + done)", "out_of.eq(out_of + begun)"),
        ),
        broken_depth=20,  # until there is no more room
    ),
    Proof(
        "spread_ratio",
        SpreadRatio,
        "three dots with shifts of -1, 0 and 1; its values have a proof of their own",
        spread_ratio,
        depth=2,
        breaks=(
            ("(self.i.valid & ~self.o.valid) if", "self.i.valid if"),
            ("n_ < LEAST_DOTS", "n_ < LEAST_DOTS - 1"),
            ("step.eq(bits - 1)", "step.eq(bits - 2)"),
            ("self.i.ready.eq(1)", "self.i.ready.eq(self.o.ready)"),
        ),
        broken_depth=30,
    ),
    *(
        Exhaustive(
            f"spread_ratio_{name}",
            SpreadRatio,
            f"{len(places)} dots, each in contact or not, and all shifts of {values} along both axes",
            "spreads with their definition",
            partial(trial, places=places, limit=limit, bits=bits),
            cases=1 << len(places) * (1 + 2 * bits),
            clocks=(1 << len(places) * (1 + 2 * bits)) * 80,
            breaks=breaks,
        )
        for name, (places, limit, bits), values, breaks in (
            ("three", THREE, "-2 to 1 / 64 px", (("fits = brought >= divisor", "fits = brought > divisor"),)),
            (
                "five",
                FIVE,
                "-3 and 3 / 64 px",
                (
                    ("b.load(v, x, minus=True)", "b.load(v, x)"),
                    ("*c.load(y, y, minus=True)", "*c.load(y, y)"),
                ),
            ),
        )
    ),
)
