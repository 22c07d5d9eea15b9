# amaranth: UnusedElaboratable=no
"""Proof of the means over a window: each beat leaves once, in its turn, and a whole frame by itself."""

from functools import partial
from itertools import pairwise

import numpy as np
from amaranth import Array, Cat, Const, Mux, Signal, Value, signed

from fastac.gateware.network.feature_smoothing import FeatureSmoothing
from fastac.models.integer.features import WIDTH
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.frame_order import FrameCounter
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.pipelines import waits
from fastac.sim.formal.proofs.reordering import opened


def in_turn(component: type, window_px: int, height: int, width: int, lanes: int) -> FormalBench:
    """A beat leaves for each that enters, with the coordinates of its turn, whatever the resets.

    A frame that comes in moves on what is inside with each of its beats; between frames all moves by itself.
    """
    u, v = np.arange(width) - 1, np.arange(height) + 1
    dut = component(window_px, 1, u, v, lanes=lanes)
    memories = opened(dut).submodules
    bench = FormalBench(dut)
    beats, ahead = dut.beats, dut.half * dut.beats
    count, depth = height * beats, dut.delay_of(window_px, width, lanes) - ahead
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    entered, left = FrameCounter(bench, "in", enters, count), FrameCounter(bench, "out", leaves, count)
    inside = Signal(range(depth + count + 2))
    bench.m.d.sync += inside.eq(inside + enters - leaves)

    def codes(place: Value) -> Value:
        """What is known of the beat at a place of its frame: the codes of its columns, then of its row."""
        words = [
            [*u[beat : beat + lanes], v[row]] for row in range(height) for beat in range(0, width, lanes)
        ]
        return Array(Cat(Const(int(code), signed(WIDTH)) for code in word) for word in words)[place]

    payload = dut.o.payload
    found = Cat(*(payload[lane][1] for lane in range(lanes)), payload[0][2])
    turn = codes(left.place)
    bench.always("what is offered has the coordinates of its turn", ~dut.o.valid | (found == turn))
    for lane in range(lanes):
        bench.always(f"all lanes are of one row: {lane}", payload[lane][2] == payload[0][2])
    bench.always(
        "no deadlock: takes a beat when its last stage moves on", dut.i.ready == (dut.o.ready | ~dut.o.valid)
    )

    # For the induction: which beats are in the middle of the rows and behind it, and which are ahead of it.
    widths = (1, len(Signal(range(height))), len(Signal(range(beats))))
    valid, places = [], []
    for k in range(depth):
        place = bench.probe(f"place_{k}", sum(widths))
        row, beat = place[1 : 1 + widths[1]], place[1 + widths[1] :]
        valid.append(place[0])
        places.append(bench.wire(f"at_{k}", row * beats + beat))
        bench.always(f"stage {k}: a beat of the frame", ~place[0] | ((row < height) & (beat < beats)))
    passed = Cat(valid)
    for k, (new, old) in enumerate(pairwise(places)):
        follows = Mux(old == count - 1, 0, old + 1)
        bench.always(f"stage {k}: the beat that follows", ~(valid[k] & valid[k + 1]) | (new == follows))
        bench.always(f"stage {k}: begins a frame", ~(valid[k] & ~valid[k + 1]) | (new == 0))
        bench.always(f"stage {k + 1}: ends a frame", ~(valid[k + 1] & ~valid[k]) | (old == count - 1))
    within = bench.wire("within", entered.place != 0)
    to_come = bench.probe("left", range(ahead + 1))
    bench.always("beats of the frame that comes in", bench.probe("entered", range(count)) == entered.place)
    bench.always("no first beat to come between frames", within | (to_come == 0))
    bench.always(
        "steps until the first beat is in the middle",
        ~within | (to_come == 0) | (entered.place + to_come == ahead + 1),
    )
    bench.always(
        "the middle is behind the beat that comes in",
        ~within | (to_come != 0) | (valid[0] & (places[0] + ahead + 1 == entered.place)),
    )
    frame_ends = places[0] + Mux(within, to_come, ahead + 1) >= count
    bench.always("the frame before has passed by then", ~valid[0] | (within & (to_come == 0)) | frame_ends)
    before = Mux(valid[0] & ~(within & (to_come == 0)), count - 1 - places[0], 0)
    coming = Mux(within, Mux(to_come == 0, ahead, entered.place), 0)
    bench.always(
        "no beat lost or made up: inside are those in the stages and ahead of them",
        inside == dut.o.valid + ones(passed) + before + coming,
    )
    following = (left.place + dut.o.valid + ones(passed)) % count
    bench.always("the middle is in its turn", following == Mux(valid[0], (places[0] + 1) % count, 0))
    read = Cat(*(Value.cast(getattr(memories, name).read_ports[0].data) for name in ("u", "v")))
    bench.always("the codes read are the last stage's", ~valid[-1] | (read == codes(places[-1])))
    waits(bench, (inside != 0) & ~within, passed)
    return bench


PROOFS = tuple(
    Proof(
        f"feature_smoothing_{window_px}_{lanes}",
        FeatureSmoothing,
        f"{height} × {width} pixels of one channel, {lanes} a beat, windows of {window_px}; a larger frame"
        " has more of the same rows and columns, and differences have no part in the handshake",
        partial(in_turn, window_px=window_px, height=height, width=width, lanes=lanes),
        depth=1,
        breaks=(
            ("(pending & ~within)", "pending"),
            ("(pending & ~within)", "0"),
            ("room.eq(self.o.ready | ~self.o.valid)", "room.eq(1)"),
            ("entered == count - 1", "entered == count - 2"),
            ("If(left == 1)", "If(left == 2)"),
            ("middle.row == self.height - 1", "middle.row == self.height - 2"),
            ("self._codes(m, step, places[-2])", "self._codes(m, step, places[-3])"),
        ),
        broken_depth=24,
        quick=lanes == 1,
    )
    for window_px, height, width, lanes in ((2, 2, 3, 1), (4, 3, 4, 2))
)
