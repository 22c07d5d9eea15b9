import sqlite3
from dataclasses import replace

import pytest

from fastac.sweep.results import Results, ResultsError, Row

ROW = Row("a", "done", {"x": [1, 2]}, {"name": "tiny"}, {"dsp": 3, "error": 0.25}, "", 1.5, "now")


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "new" / "r.sqlite")


def test_rows_come_back(results):
    bad = Row("b", "infeasible", {}, None, error="too short", generation="now")
    results.add(ROW)
    results.add(bad)
    assert Results(results.path).rows() == [ROW, bad]


def test_a_point_that_is_measured_again_replaces_the_old_one(results):
    results.add(replace(ROW, status="failed", error="killed"))
    results.add(ROW)
    assert results.rows() == [ROW]


def test_rows_of_one_generation(results):
    results.add(ROW)
    results.add(replace(ROW, key="old", generation="before"))
    assert results.rows("now") == [ROW]
    assert len(results.rows()) == 2


def test_a_status_that_is_none(results):
    with pytest.raises(ResultsError, match="CHECK constraint failed"):
        results.add(replace(ROW, status="perhaps"))


def test_a_writer_that_dies_leaves_whole_points(results):
    """A transaction that is not committed is not there."""
    results.add(ROW)
    connection = sqlite3.connect(results.path)
    connection.execute("DELETE FROM points")
    connection.close()
    assert results.rows() == [ROW]


def test_facts_trials_and_confirmations(results):
    results.set_facts({"spec": {"a": 1}})
    results.set_facts({"spec": {"a": 2}, "more": None})
    assert results.facts() == {"format_version": "1", "spec": {"a": 2}, "more": None}
    for key in "ba":
        results.add_trial({"axis": 3}, key)
    assert results.trials() == [({"axis": 3}, "b"), ({"axis": 3}, "a")]
    results.confirm("a", {"is_exact": True})
    assert results.confirmations() == {"a": {"is_exact": True}}


def test_files_that_are_no_results(tmp_path):
    missing, text = tmp_path / "none.sqlite", tmp_path / "text.sqlite"
    with pytest.raises(ResultsError, match=r"none\.sqlite: no such file"):
        Results(missing, create=False)
    assert not missing.exists()
    text.write_text("this is not a database, however long it may be" * 100)
    with pytest.raises(ResultsError, match=r"text\.sqlite: no results of a sweep: "):
        Results(text, create=False)


def test_another_format(results):
    results.set_facts({"format_version": "2"})
    with pytest.raises(ResultsError, match=r"r\.sqlite: format_version = '2': expected '1'"):
        Results(results.path)
