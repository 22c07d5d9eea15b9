"""Proof of the table that is read ahead: each word in turn, two clocks after it is taken, and never late."""

from functools import partial

import numpy as np
from amaranth import Array, Const, Mux, Signal

from fastac.gateware.stream.read_ahead_rom import FETCH_REGISTERS, QUEUE_WORDS, ReadAheadRom
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.streams import fifo_words

TABLE = np.array([[3], [-4], [0], [2], [-1]])
BITS = 3


def in_turn(component: type, bank_words: int) -> FormalBench:
    """The words come in the table's order, again and again, whenever they are taken.

    The words in the queue and on their way to it are the next ones, and their number is that of the credits.
    """
    dut = component(TABLE, BITS, bank_words=bank_words)
    bench = FormalBench(dut)
    m, depth = bench.m, len(TABLE)
    words = Array(Const(int(word) & (1 << BITS) - 1, BITS) for word in TABLE[:, 0])
    take = bench.free("take")
    bench.assume(~take | dut.ready)
    bench.drive(dut.take, take)
    turn, clock = Signal(range(depth)), bench.clocks(dut.start)
    with m.If(take):
        m.d.sync += turn.eq(Mux(turn == depth - 1, 0, turn + 1))
    bench.always("a turn is a word's", turn < depth)
    taken, expected = take, words[turn]
    for stage in range(dut.latency):
        taken, expected = bench.past(taken, f"taken_{stage}"), bench.past(expected, f"expected_{stage}")
    bench.always("the word that was taken 2 clocks before", ~taken | (dut.word.as_value() == expected))
    bench.always("a word in each clock from the start on", dut.ready == (clock == dut.start))

    level, waiting = fifo_words(bench, "queue", QUEUE_WORDS, BITS, "the queue")
    fetched = bench.probe("fetched", FETCH_REGISTERS)
    under_way = bench.probe("under_way", range(QUEUE_WORDS + 1))
    for place, word in enumerate(waiting):
        bench.always(
            f"word {place} of the queue is in turn",
            (place >= level) | (word == words[(turn + place) % depth]),
        )
    bench.always("what is ready is in the queue", ~dut.ready | (level != 0))
    bench.always("a credit for each word in the queue and under way", under_way == level + ones(fetched))
    bench.always("no more of them than places", under_way <= QUEUE_WORDS)
    bench.always("no fetch without a credit", bench.probe("full") == (under_way == QUEUE_WORDS))
    following = bench.probe("following", range(depth))
    bench.always("the next to be fetched is in turn", following == (turn + under_way) % depth)
    begun = [Const((2 << k) - 1, FETCH_REGISTERS) for k in range(FETCH_REGISTERS)]
    for k, first in enumerate(begun):
        bench.always(
            f"clock {k}: the first words are under way", (clock != k) | ((fetched == first) & (level == 0))
        )
    return bench


PROOFS = (
    Proof(
        "read_ahead_rom",
        ReadAheadRom,
        "five words of 3 bits in three banks: words are only passed on",
        partial(in_turn, bank_words=2),
        depth=FETCH_REGISTERS + 3,
        breaks=(
            ("under_way + ~full - self.take", "under_way + ~full - self.ready"),
            ("after == QUEUE_WORDS", "after == QUEUE_WORDS - 2"),
            ("following == depth - 1", "following == depth - 2"),
            ("passed_bank.eq(read_bank)", "passed_bank.eq(bank)"),
            ("fetched.eq(Cat(~full, fetched))", "fetched.eq(Cat(1, fetched))"),
        ),
    ),
)
