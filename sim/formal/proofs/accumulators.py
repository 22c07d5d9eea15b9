"""Proofs of accumulators: within the declared ranges no register of a sum differs from the unbounded sum.

The bench adds the same numbers in words that are wide enough for anything. The width of an accumulator
follows from a bound, |constant| + Σ over a frame's beats of the largest magnitude of each word. The proof is
by induction over the beats, with the bound of the beats so far as the invariant: neither the number of beats
nor the ranges matter to it, so small ones stand for all. That the bound is reached, a copy with one bit less
shows: it fails.
"""

from functools import partial

import numpy as np
from amaranth import Array, Cat, Const, Mux, Signal, Value, signed

from fastac.gateware.arithmetic.frame_sum import FrameAccumulator
from fastac.gateware.force.block_address import BlockAddress
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.mlp_mvm import MvmCore
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.network import Layer
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.engines import weighted_flow

WIDE = signed(16)
"""Words of the bench's own sums."""


def _within(value: Value, limits: np.ndarray, place: Value) -> Value:
    """|value| is at most the limit at `place`."""
    limit = Array(Const(int(limit)) for limit in limits)[place]
    return (value <= limit) & (-limit <= value)


def frame_sum(component: type, bounds: np.ndarray, constant: int) -> FormalBench:
    """The sum of a frame is constant + Σ words, for all words within `bounds`, frame after frame."""
    dut = component(bounds[:, None], np.array([constant]))
    bench = FormalBench(dut)
    m, beats, advance = bench.m, len(bounds), dut.i.ready
    enters, _ = bench.source(dut.i, "i")
    bench.sink(dut.o, "o")

    def counted(name: str, step: Value) -> Signal:
        place = Signal(range(beats), name=name)
        with m.If(step):
            m.d.sync += place.eq(Mux(place == beats - 1, 0, place + 1))
        bench.always(f"{name} is inside the frame", place < beats)
        return place

    # Unbounded sums on the way through the adder tree; each beat's words are within their bounds.
    entered = counted("entered", enters)
    nodes, limits, valid, where = list(dut.i.payload[0]), bounds, dut.i.valid, entered
    for node, limit in zip(nodes, limits.T, strict=True):
        bench.assume(_within(node, limit, entered))
    stages = []
    for level in range(dut.latency - 1):
        sums = [Signal(WIDE, reset_less=True, name=f"exact{level}_{k}") for k in range((len(nodes) + 1) // 2)]
        stage = Signal(name=f"valid_{level}"), Signal(range(beats), name=f"where_{level}", reset_less=True)
        with m.If(advance):
            m.d.sync += [total.eq(sum(nodes[2 * k : 2 * k + 2])) for k, total in enumerate(sums)]
            m.d.sync += [stage[0].eq(valid), stage[1].eq(where)]
        (valid, where), nodes = stage, sums
        limits = np.add.reduceat(limits, np.arange(0, limits.shape[1], 2), axis=1)
        stages.append(stage)
        for k, (node, limit) in enumerate(zip(nodes, limits.T, strict=True)):
            own = bench.probe(f"axis_0_sum{level}_{k}", int(limit.max()).bit_length() + 1).as_signed()
            bench.always(f"sum {k} of level {level} is the unbounded sum", ~valid | (own == node))
            bench.always(
                f"sum {k} of level {level} is within its bound", ~valid | _within(node, limit, where)
            )

    # The unbounded sum of the frame.
    arrives = bench.wire("arrives", valid & advance)
    summed = counted("summed", arrives)  # beats of the frame that are in the sum
    exact, complete = Signal(WIDE, reset_less=True), Signal()
    with m.If(arrives):
        m.d.sync += exact.eq(Mux(summed == 0, constant, exact) + nodes[0])
    with m.If(advance):
        m.d.sync += complete.eq(arrives & (summed == beats - 1))

    own = bench.probe("accumulator_0", len(dut.o.payload[0])).as_signed()
    bench.always("the accumulator is the unbounded sum", own == exact)
    bench.always("a frame's sum is offered once", dut.o.valid == complete)
    bench.always(
        "the sum that is offered is the frame's", ~complete | ((summed == 0) & (dut.o.payload[0] == exact))
    )
    bench.always("no deadlock: takes a beat unless its sum waits", advance | (complete & ~dut.o.ready))

    # For the induction: the bound of the beats so far, and which beats are under way.
    so_far = abs(constant) + np.cumsum(bounds.sum(axis=1))
    begun = (summed != 0) | complete
    bench.always(
        "the sum is within the bound of its beats", ~begun | _within(exact, np.roll(so_far, 1), summed)
    )
    if beats > 1:
        bench.always("the beats in the sum", bench.probe("beat", range(beats)) == summed)
    bench.always("a new frame begins with the constant", bench.probe("fresh") == (summed == 0))
    following: Value = summed
    own = bench.probe("valid", len(stages)) if stages else []
    for level, (valid, where) in reversed(list(enumerate(stages))):
        bench.always(f"whether a beat is in level {level}", own[level] == valid)
        bench.always(f"which beat is in level {level}", ~valid | (where == following))
        step = Signal(range(beats), name=f"following_{level}")
        m.d.comb += step.eq(Mux(valid, Mux(following == beats - 1, 0, following + 1), following))
        following = step
    bench.always("which beat enters", entered == following)
    return bench


def _one_stall(bench: FormalBench, moves: Value) -> None:
    """Assume that of two clocks in a row one is not stalled: in longer stalls nothing moves any more."""
    stalled = Signal(reset_less=True)
    bench.m.d.sync += stalled.eq(~moves)
    bench.assume(moves | ~stalled)


def _later(bench: FormalBench, advance: Value, value: Value, name: str) -> Signal:
    """`value` a step of the pipeline later."""
    held = Signal(Value.cast(value).shape(), reset_less=True, name=name)
    with bench.m.If(advance):
        bench.m.d.sync += held.eq(value)
    return held


def _terms(x: Value, bends: tuple[int, ...]) -> list[Value]:
    """Those of `integer.force.terms`."""
    if not bends:
        return [x]
    band, *deep = bends
    beyond = Mux(x > band, x - band, 0), Mux(x < -band, x + band, 0)
    return [x, *beyond, *(Mux(x > bend, x - bend, 0) for bend in deep)]


def _place_of_square(bench: FormalBench, weighted: WeightedSum, place: Value):
    """Assert that the beat at `place` of a frame reads the word of its square, and what that follows from."""
    squares = BlockAddress.of(weighted, 2)
    row, beat = np.indices((squares.rows, squares.beats)).reshape(2, -1)
    row_start = (row + squares.cut_rows) // squares.side * squares.row_words
    for name, values in {
        "address": row_start + beat // squares.width,
        "row_start": row_start,
        "row": row + squares.cut_rows,
        "beat": beat,
    }.items():
        found = bench.probe(f"weights.squares.{name}", range(int(values.max()) + 1))
        expected = Array(Const(int(value), 8) for value in values)[place]
        bench.always(f"the weights' square: {name}", found == expected)


def weighted(
    component: type,
    weight: np.ndarray,
    constant: int,
    bits: int,
    bends: tuple[int, ...] = (),
    **squares: int,
) -> FormalBench:
    """The sum of a frame is constant + Σ weight · x, for all x; weight (rows, columns, terms).

    squares : `block_px` and `cut_rows` of the sum
    """
    given = WeightedSum(weight[None], np.array([constant]), bits, True, **squares)
    dut = component(given, lanes=2, **({"bends": bends} if bends else {}))
    bench = FormalBench(dut)
    m, beats, weights = bench.m, dut.interval, weight.reshape(-1, 2, weight.shape[2])
    entered, arrives, place = weighted_flow(bench)
    _one_stall(bench, dut.o.ready)
    if squares:
        _place_of_square(bench, given, entered.place)
    else:
        bench.always("the weights' place", bench.probe("weights.address", range(beats)) == entered.place)

    total = Const(0, WIDE)
    for k, x in enumerate(dut.i.payload):
        bench.assume(x != -(1 << (bits - 1)))
        for t, value in enumerate(_terms(x, bends)):
            total += value * Array(Const(int(w), signed(8)) for w in weights[:, k, t])[entered.place]
    moves = bench.probe("advance")
    sums = bench.probe("accumulator.advance")
    for step in range(5):
        total = _later(bench, moves, total, f"total_{step}")
    total = _later(bench, sums, total, "total_5")
    exact = Signal(WIDE, reset_less=True)
    with m.If(sums & arrives):
        m.d.sync += exact.eq(Mux(place == 0, constant, exact) + total)

    own = bench.probe("accumulator.accumulator_0", given.width).as_signed()
    bench.always("the accumulator is the unbounded sum", own == exact)
    so_far = abs(constant) + np.cumsum(np.abs(weights).sum(axis=(1, 2))) * given.input_limit
    begun = (place != 0) | dut.o.valid
    bench.always(
        "the sum is within the bound of its beats", ~begun | _within(exact, np.roll(so_far, 1), place)
    )
    return bench


def tile(component: type, loadable: bool) -> FormalBench:
    """Each neuron's sum is Σ weight · x + bias, for all x; if they are loadable, all weights and biases."""
    weight, bias = [[3, -2], [-3, 3]], [-5, 7]
    layer = Layer(np.array(weight), np.array(bias), np.array([2, 1]), 3, loadable=loadable)
    dut = component(layer, input_width=2, input_signed=True)
    bench = FormalBench(dut)

    def unknown(name: str, limit: int) -> Value:
        return bench.constant(name, range(2 * limit + 1)) - limit

    if loadable:
        weight = [[unknown(f"weight_{k}_{j}", layer.weight_limit) for j in range(2)] for k in range(2)]
        bias = [unknown(f"bias_{k}", layer.bias_limit) for k in range(2)]
        words = [dut.packing.word(*pair)[: dut.packing.width] for pair in zip(*weight, strict=True)]
        bench.drive(dut.parameters, Cat(words, (b[: dut.bias_width] for b in bias)))
    for x, limit in zip(dut.i, layer.input_limit.tolist(), strict=True):
        bench.assume((x <= limit) & (x >= -limit))
    given = Const(1)
    sums = []
    for k in range(2):
        terms = (w * x for w, x in zip(weight[k], dut.i, strict=True))
        total = Signal(WIDE, name=f"sum_{k}")
        bench.m.d.comb += total.eq(sum(terms, bias[k]))
        sums.append(total)
    for step in range(dut.latency):
        given = _later(bench, Const(1), given, f"given_{step}")
        sums = [_later(bench, Const(1), total, f"sum_{k}_{step}") for k, total in enumerate(sums)]
    for k, total in enumerate(sums):
        bench.always(f"neuron {k} is the unbounded sum", ~given | (dut.o[k] == total))
    return bench


PATTERN = [[[1, -1, 1, 2], [0, 1, -1, 0]], [[-1, 2, 0, -1], [1, 0, 1, -2]]]
BENT_WEIGHTS = np.array(PATTERN * 4).reshape(4, 4, 4)
"""A weight for a value of 3 bits, one for what is beyond 1 on either side, and one for what is beyond 2."""
SQUARE_WEIGHTS = np.repeat([[1, -1], [0, 1], [0, 1], [-1, 0]], 2, axis=1)[..., None]
"""The same in squares of 2 × 2 pixels, of which the uppermost and the lowest are cut in half."""
ONE_STALL = "stalls of one clock; in a longer one nothing moves any more"

FRAMES = tuple(
    Proof(
        f"frame_sum_{len(bounds)}_{len(bounds[0])}",
        FrameAccumulator,
        f"frames of {len(bounds)} beats of {len(bounds[0])} words, largest magnitudes {bounds},"
        f" constant {constant}; axes are alike",
        partial(frame_sum, bounds=np.array(bounds), constant=constant),
        depth=1,
        breaks=(
            ("bounds.sum(axis=(0, 2))).max())", "bounds.sum(axis=(0, 2))).max()) // 2"),
            ("fresh.eq(last)", "fresh.eq(0)"),
            ("done.eq(summed & last)", "done.eq(last)"),
            ("advance.eq(self.o.ready | ~done)", "advance.eq(1)"),
        ),
        quick=len(bounds) == 2,
    )
    for bounds, constant in (
        (((3,), (1,)), -3),
        (((3, 1, 0), (0, 2, 3), (7, 5, 1)), 9),
    )
)

PROOFS = (
    *FRAMES,
    Proof(
        "weighted_sum_bound",
        WeightedSumStream,
        f"frames of 4 × 4 values of 3 bits, two a beat, weights of either sign; {ONE_STALL}",
        partial(weighted, weight=np.array([[1, -1], [0, 1]] * 4).reshape(4, 4, 1), constant=-2, bits=3),
        depth=16,
        breaks=(
            ("signed_width(int(bound))", "signed_width(int(bound)) - 1"),
            (
                "reached = np.abs(self.weighted.weight) * self.weighted.input_limit",
                "reached = np.abs(self.weighted.weight)",
            ),
        ),
        broken_depth=20,
    ),
    Proof(
        "weighted_sum_bends",
        WeightedSumStream,
        f"frames of 4 × 4 values of 3 bits, two a beat, with bends at 1 and 2; {ONE_STALL}",
        partial(weighted, weight=BENT_WEIGHTS, constant=-2, bits=3, bends=(1, 2)),
        depth=16,
        breaks=(
            ("signed_width(int(bound))", "signed_width(int(bound)) - 1"),
            ("[list(of_lane) for", "[list(of_lane)[::-1] for"),
        ),
        broken_depth=20,
    ),
    Proof(
        "weighted_sum_squares",
        WeightedSumStream,
        f"frames of 4 × 4 values of 3 bits, two a beat, the same weights in squares of 2 × 2; {ONE_STALL}",
        partial(weighted, weight=SQUARE_WEIGHTS, constant=-2, bits=3, block_px=2, cut_rows=1),
        depth=16,
        breaks=(("words.reshape(len(words), -1)", "words[::-1].reshape(len(words), -1)"),),
        broken_depth=20,
    ),
    *(
        Proof(
            f"tile_bound_{name}",
            MvmCore,
            f"two neurons of two inputs, {name} weights of 3 bits",
            partial(tile, loadable=name == "loadable"),
            depth=depth,
            breaks=breaks,
        )
        for name, depth, breaks in (
            (
                "baked",
                8,
                (("biased.value, held,", "biased.value, Range(held.low, held.high // 2),"),),
            ),
            (
                "loadable",
                8,
                (
                    ("reached + bias.bound", "reached"),
                    ("largest = self.packing.limit if packed", "largest = self.layer.weight_limit if packed"),
                ),
            ),
        )
    ),
)
