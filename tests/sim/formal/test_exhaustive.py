# amaranth: UnusedElaboratable=no
"""An exhaustive trial finds wrong results, and cases that were not tried."""

from dataclasses import replace

import pytest
from amaranth import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.sim.formal.exhaustive import Exhaustive, Trial


class Halved(wiring.Component):
    """Half of a word, rounded down."""

    i: In(6)
    o: Out(5)

    def elaborate(self, platform):
        m = Module()
        m.d.comb += self.o.eq(self.i >> 1)
        return m


class HalvedTrial(Trial):
    """All words of 6 bits."""

    def __init__(self, component):
        self.component = component
        super().__init__()

    def elaborate(self, platform):
        m = Module()
        m.submodules.halved = halved = self.component()
        case = Signal(7)
        m.d.comb += halved.i.eq(case)
        m.d.sync += [case.eq(case + ~case[-1]), self.done.eq(case[-1])]
        self.count(m, [~case[-1]], [halved.o != case[:6] // 2])
        return m


HALVED = Exhaustive(
    "halved",
    Halved,
    "words of 6 bits",
    "each half",
    HalvedTrial,
    64,
    100,
    (("self.i >> 1", "(self.i + 1) >> 1"),),
)


def test_counts_cases_and_wrong_results(tmp_path):
    found = HALVED.run(tmp_path)
    assert (found.status, found.failed, found.cases) == ("pass", (), 64)
    missing = replace(HALVED, cases=65).run(tmp_path)
    assert (missing.status, missing.failed) == ("fail", ("65 cases: 64 were tried",))
    broken = HALVED.run(tmp_path / "broken", 0)
    assert (broken.status, broken.failed) == ("fail", ("each half: 32 differ",))
    assert HALVED.key() != HALVED.key(0)


def test_a_trial_that_does_not_end_is_an_error(tmp_path):
    with pytest.raises((RuntimeError, SystemExit)):
        replace(HALVED, clocks=20).run(tmp_path)
