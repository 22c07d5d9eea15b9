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


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("axes", "[" * 100_000, "axes: damaged (maximum recursion"),
        ("axes", "9" * 5000, "axes: damaged (Exceeds the limit"),
        ("axes", "[]", "axes = '[]': expected dict"),
        ("scene", "3", "scene = '3': expected dict"),
        ("metrics", b"\xff", "metrics: damaged"),
        ("metrics", '{"dsp": "x"}', "dsp = 'x': expected a number"),
        ("metrics", '{"dsp": true}', "dsp = True: expected a number"),
        ("seconds", "long", "seconds = 'long': expected float"),
        ("generation", b"\xff", r"generation = b'\xff': expected str"),
    ],
)
def test_a_damaged_point(results, column, value, message):
    results.add(ROW)
    with sqlite3.connect(results.path) as connection:
        connection.execute(f"UPDATE points SET {column} = ?", (value,))
    connection.close()
    with pytest.raises(ResultsError) as caught:
        results.rows()
    assert str(caught.value).startswith(f"{results.path}: point 'a': ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("change", ["DROP TABLE trials", "ALTER TABLE trials RENAME COLUMN choice TO other"])
def test_other_tables(results, change):
    with sqlite3.connect(results.path) as connection:
        connection.execute(change)
    connection.close()
    with pytest.raises(ResultsError, match=r"r\.sqlite: no results of a sweep: no such (table|column)"):
        results.trials()


def test_a_damaged_page(results):
    for k in range(50):
        results.add(replace(ROW, key=f"{k}"))
    with sqlite3.connect(results.path) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
    connection.close()
    whole = results.path.read_bytes()
    results.path.write_bytes(whole[:4096] + b"\xff" * (len(whole) - 4096))
    with pytest.raises(ResultsError, match=r"r\.sqlite: no results of a sweep: .*malformed"):
        results.rows()
