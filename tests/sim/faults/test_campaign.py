"""What a campaign plays, with a bench that answers at once; test_batch.py beside it has the real one."""

from types import SimpleNamespace

import pytest

from fastac.sim.faults import campaign
from fastac.sim.faults.campaign import BATCH, DIRECTED, Campaign
from fastac.sim.faults.designs import DESIGNS
from fastac.sim.faults.generator import goal_of, goals
from fastac.sim.faults.kinds import KINDS
from fastac.sim.faults.script import Shape

SHAPE = Shape(16, 4, 2, loadable=True)
NEVER, LATE = ("power_up", "PAD"), ("soft_reset", "PAD")


class FakeStore:
    """Performs batches in which one goal is never reached, and another one at its third attempt only."""

    def __init__(self):
        self.batches, self.aims = [], 0

    def perform(self, step):
        if step.name == "fault_design":
            return None
        design, seed, numbers = (step.arguments[name] for name in ("design", "seed", "numbers"))
        self.batches.append((design, numbers))
        return SimpleNamespace(
            value={"records": [self.record(design, seed, n) for n in numbers], "seconds": 2.0}
        )

    def record(self, design, seed, number):
        kind, state = goal_of(SHAPE, design, seed, number)
        self.aims += (kind, state) == LATE
        missed = (kind, state) == NEVER or ((kind, state) == LATE and self.aims < 10)
        found = ["LINE" if missed else state, "inside"]
        return {"number": number, "kinds": [kind], "states": [found], "slow_outputs": 0}


@pytest.fixture
def run(monkeypatch, tmp_path):
    store = FakeStore()
    monkeypatch.setattr(Campaign, "store", store)
    monkeypatch.setattr(Campaign, "hardware", lambda self, design: SimpleNamespace(shape=SHAPE))
    monkeypatch.setattr(campaign, "perform_all", lambda *arguments, **settings: None)
    designs = ["normals_4", "depth_2"]
    return Campaign(designs, 1, tmp_path, tmp_path, jobs=2, progress=False), store


def test_faults_are_spread_and_what_was_missed_is_aimed_at_again(run):
    played, store = run
    coverage = played.run(600, rounds=4)
    first = [(design, numbers) for design, numbers in store.batches if numbers[0] < 300]
    assert [len(numbers) for _, numbers in first] == [BATCH] * 8
    for design in played.designs:
        numbers = [n for name, chosen in store.batches if name == design for n in chosen]
        assert numbers[:300] == list(range(300))
        assert len(set(numbers)) == len(numbers)
        aimed = [goal_of(SHAPE, design, 1, number) for number in numbers[300:]]
        assert set(aimed) == {NEVER, LATE}
        assert aimed.count(NEVER) == 4 * DIRECTED
        assert 0 < aimed.count(LATE) < 4 * DIRECTED
    assert coverage.missing() == [NEVER]
    assert played.seconds == dict.fromkeys(played.designs, 2.0 * (4 + 4))


def test_nothing_more_is_played_without_rounds(run):
    played, store = run
    coverage = played.run(2 * len(goals(SHAPE)), rounds=0)
    assert set(coverage.missing()) == {NEVER, LATE}
    assert sum(len(numbers) for _, numbers in store.batches) == 2 * len(goals(SHAPE))


def test_designs_have_every_solver_with_every_width_and_every_output():
    solvers = {(d.get("solver", "dst2d"), d.get("lanes", 1)) for d in DESIGNS.values()}
    assert {(s, k) for s in ("dst2d", "tridiagonal", "adjoint") for k in (1, 2, 4)} <= solvers
    outputs = {output for d in DESIGNS.values() for output in d["outputs"]}
    assert {"normals", "depth", "force_z", "force_xyz", "force_map"} <= outputs
    for key, values in (("weights", {"loadable", "baked"}), ("bus_errors", {"flag", "respond"})):
        default = {"weights": "loadable", "bus_errors": "flag"}[key]
        assert {d.get(key, default) for d in DESIGNS.values()} == values
    assert all(len(kind.meaning) > 10 for kind in KINDS.values())
