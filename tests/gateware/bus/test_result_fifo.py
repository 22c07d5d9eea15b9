# amaranth: UnusedElaboratable=no
"""The FIFO of results against a queue in Python, in every clock."""

import random
from collections import deque

import pytest
from amaranth import Signal
from amaranth.sim import Simulator

from fastac.gateware.bus.record import FIFO_RECORDS, RECORD_BYTES
from fastac.gateware.bus.result_fifo import ResultFifo

LOST = (1 << 32) - 20
"""Lost records at the beginning: shortly before the count wraps, so that each of its bits changes."""


class Reference:
    """The words that wait, oldest first, and the number of records lost."""

    def __init__(self, fifo: ResultFifo, lost: int):
        self.fifo, self.words, self.lost = fifo, deque(), lost

    @property
    def waiting(self) -> int:
        """Records of which a word has not been read."""
        return -(-len(self.words) // self.fifo.words)

    @property
    def word(self) -> int:
        return self.words[0] if self.words else 0

    def step(self, record: int | None, *, read: bool, clear: bool) -> bool:
        """One clock; returns whether the record is lost."""
        lost = record is not None and self.waiting == self.fifo.records and not clear
        if clear:
            self.words.clear()
        elif read and self.words:
            self.words.popleft()
        if record is not None and not lost:
            mask = (1 << self.fifo.width) - 1
            self.words += [record >> self.fifo.width * k & mask for k in range(self.fifo.words)]
        self.lost = (self.lost + lost) % (1 << 32)
        return lost


def play(fifo: ResultFifo, clocks: int, rates, seed: int = 1) -> None:
    """Random records, reads and clears for some clocks, all outputs compared in each.

    rates : probabilities per clock of a record, a read and a clear, another triple for each tenth of the time
    """
    reference, rng = Reference(fifo, LOST), random.Random(seed)
    seen = {"lost": 0, "cleared": 0, "full": 0, "last word": 0}

    async def bench(ctx):
        for clock in range(clocks):
            record_rate, read_rate, clear_rate = rates[clock * 10 // clocks % len(rates)]
            record = rng.getrandbits(fifo.words * fifo.width) if rng.random() < record_rate else None
            read, clear = rng.random() < read_rate, rng.random() < clear_rate
            ctx.set(fifo.record, record or 0)
            ctx.set(fifo.record_valid, record is not None)
            ctx.set(fifo.read, read)
            ctx.set(fifo.clear, clear)
            found = [ctx.get(s) for s in (fifo.word, fifo.waiting, fifo.lost_count)]
            assert found == [reference.word, reference.waiting, reference.lost], f"clock {clock}"
            seen["full"] += reference.waiting == fifo.records
            seen["cleared"] += clear and len(reference.words) % fifo.words > 0
            seen["last word"] += read and len(reference.words) % fifo.words == 1
            lost = reference.step(record, read=read, clear=clear)
            assert ctx.get(fifo.lost) == lost, f"clock {clock}"
            seen["lost"] += lost
            await ctx.tick()

    simulator = Simulator(fifo)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert all(seen.values()), f"{seen}: expected each"
    assert reference.lost < LOST, "the count of lost records did not wrap"


@pytest.mark.parametrize(("records", "words", "width"), [(16, 16, 32), (2, 2, 3), (4, 8, 5)])
def test_records_leave_whole_and_in_order(records, words, width):
    """Slow and fast readers, records in adjacent clocks, and clears in the clocks of anything else."""
    often, seldom = 2 / words, 0.5 / words
    rates = [(often, 0.7, 0), (0.5 * seldom, 0.9, 0), (0.9, 0.3, 0), (often, 0.9, 0.02), (0.5, 0.5, 0.3)]
    fifo = ResultFifo(records, words, width)
    fifo.lost_count = Signal(32, init=LOST)
    play(fifo, 6000, rates)


def test_size_is_that_of_the_records():
    fifo = ResultFifo()
    assert fifo.records == FIFO_RECORDS
    assert fifo.words * fifo.width == 8 * RECORD_BYTES


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"records": 12}, "records 12: expected a power of two, 2 or more"),
        ({"words": 1}, "words 1: expected a power of two, 2 or more"),
    ],
)
def test_invalid_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        ResultFifo(**arguments)
