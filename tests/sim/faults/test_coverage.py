from fastac.sim.faults.coverage import Coverage, impossible
from fastac.sim.faults.kinds import KINDS, STATES
from fastac.sim.faults.summary import evidence


def record(kinds, states, **changed):
    base = {"clocks": 100, "frames": 2, "bad": 1, "results": 1, "beats": 64, "errors": ["line_short"]}
    found = [None if state is None else [state, "inside"] for state in states]
    return base | {"number": 0, "kinds": kinds, "states": found, "slow_outputs": 0} | changed


FULL = [("normals_4", record([kind], [state])) for kind, entry in KINDS.items() for state in entry.states()]


def test_bins_that_were_not_reached_are_named():
    assert Coverage(FULL).missing() == []
    assert Coverage(FULL[1:]).missing() == [(FULL[0][1]["kinds"][0], FULL[0][1]["states"][0][0])]
    assert len(Coverage([]).missing()) == len(FULL)
    assert Coverage([("normals_4", record(["line_short"], [None]))]).states.total() == 0


def test_a_second_kind_counts_and_an_impossible_state_is_noticed():
    coverage = Coverage([("normals_4", record(["no_start", "power_up"], ["PAD", "FILL"]))])
    assert coverage.states["power_up", "FILL"] == 1
    assert coverage.unexpected() == [("no_start", "PAD")]
    assert coverage.pairs == {("no_start", "power_up"): 1}


def test_impossible_pairs_have_reasons():
    reasons = impossible()
    count = sum(map(len, reasons.values()))
    assert count == len(KINDS) * len(STATES) - len(FULL)
    assert all(len(reason) > 20 for reason in reasons)


def test_evidence_says_what_was_and_was_not_reached():
    found = evidence(FULL[1:], {"normals_4": 90.0}, seed=5, command="make faults", seconds=60)
    possible = len(FULL)
    assert f"{possible - 1:,} faults through 1 designs, seed 5" in found.summary
    assert f"{possible - 1} of {possible} possible" in found.summary
    assert "Not reached: line_short in WAIT." in found.not_covered
    by_design, by_kind, cross, places = found.tables
    assert by_design.rows[0][:2] == ["normals_4", "none"]
    assert [row[0] for row in by_kind.rows] == [row[0] for row in cross.rows] == list(KINDS)
    assert dict(zip(cross.columns, cross.rows[0], strict=True)) == {
        "kind": "line_short",
        "WAIT": 0,
        "LINE": 1,
        "DROP": 1,
        "PAD": 1,
        "FILL": 1,
    }
    assert all(len(table.columns) == len(row) for table in found.tables for row in table.rows)
    assert places.rows[0][1:5] == [0, 0, 4, 0]
