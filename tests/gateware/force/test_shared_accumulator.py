# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.force.shared_accumulator import SharedAccumulator
from fastac.models.integer.words import signed_width
from fastac.sim.check_stream import check, pack


class Sums(wiring.Component):
    """The accumulator between streams: terms with `ends`, and with `start` where it is loadable."""

    def __init__(self, accumulator: SharedAccumulator):
        self.accumulator = accumulator
        term, sums = accumulator.term.shape(), accumulator.sums.shape()
        layout = {"term": term, "ends": 1} | ({"start": sums} if accumulator.loadable else {})
        super().__init__(
            {"i": In(stream.Signature(data.StructLayout(layout))), "o": Out(stream.Signature(sums))}
        )

    def elaborate(self, platform):
        m, advance = Module(), Signal()
        m.submodules.accumulator = accumulator = self.accumulator
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            accumulator.advance.eq(advance),
            accumulator.term.eq(self.i.payload.term),
            accumulator.ends.eq(self.i.payload.ends),
            accumulator.valid.eq(self.i.valid),
            self.i.ready.eq(advance),
            self.o.payload.eq(accumulator.sums),
            self.o.valid.eq(accumulator.done),
        ]
        if accumulator.loadable:
            m.d.comb += accumulator.start.eq(self.i.payload.start)
        return m


@pytest.mark.parametrize(("axes", "loadable"), [(3, False), (2, True), (1, False)])
@pytest.mark.quick("3-False", "2-True")
def test_sums_of_terms_that_come_in_turn(tmp_path, axes, loadable):
    rng = np.random.default_rng(axes)
    limit, rounds = 50, 4
    start = rng.integers(-100, 101, axes)
    x = rng.integers(-limit, limit + 1, (5, rounds, axes))
    x[0] = limit * np.where(start < 0, -1, 1)
    x[1] = -x[0]
    expected = start + x.sum(axis=1)
    bound = int(np.abs(expected).max())
    assert bound == np.abs(start).max() + rounds * limit, "the bound is reached"
    width, bits = signed_width(bound), signed_width(limit)
    accumulator = SharedAccumulator(
        axes, width=width, term_width=bits, start=None if loadable else start, loadable=loadable
    )
    ends = np.zeros((5, rounds, axes), int)
    ends[:, -1, -1] = 1
    [image] = pack([start], width) if loadable else [0]
    inputs = [
        term | end << bits | image << (bits + 1)
        for term, end in zip(pack(x.reshape(-1, 1), bits), ends.ravel().tolist(), strict=True)
    ]
    terms = rounds * axes
    check(
        Sums(accumulator),
        "shared_accumulator",
        tmp_path,
        elastic=True,
        inputs=inputs,
        expected=pack(expected, width),
        latencies=[(terms * (f + 1) - 1, f, SharedAccumulator.latency) for f in range(5)],
    )
