"""Damaged results of sweeps: SQLite files with other rows, and with other bytes."""

import sqlite3
import tempfile
from functools import cache
from pathlib import Path

import fuzzing
import pytest
from fuzzing import Reader
from hypothesis import strategies as st
from mutations import changed_bytes

from fastac.models.random_bundle import scene
from fastac.sweep import front, page
from fastac.sweep.results import Results, Row

TABLES = {
    "facts": ("name", "value"),
    "points": ("key", "status", "axes", "scene", "metrics", "error", "seconds", "generation"),
    "trials": ("number", "choice", "key"),
    "confirmations": ("key", "content"),
}
TEXTS = (
    "",
    "{}",
    "[]",
    "null",
    "1",
    '"x"',
    "{",
    "[" * 3000,
    '{"a": NaN}',
    '{"depth_mae_mm": "x"}',
    "9" * 5000,
    "\x00",
    "done",
)


def write_sample(path: Path) -> None:
    results = Results(path)
    content = scene(("normals", "depth")).model_dump(mode="json")
    results.set_facts({"generation": "g", "scene": content, "origins": {"dsp": "counted by formula"}})
    for k in range(3):
        metrics = {
            "depth_mae_mm": 0.1 / (k + 1),
            "latency_cycles": 100 * k + 7,
            "dsp": 5 + k,
            "energy_uj": 1.0,
        }
        results.add(Row(f"key{k}", "done", {"numbers.data_bits": 18 + k}, content, metrics, "", 1.5, "g"))
    results.add(Row("key9", "failed", {"numbers.data_bits": 1}, None, {}, "no hardware", 0.1, "g"))
    results.add_trial({"numbers.data_bits": 18}, "key0")
    results.confirm(
        "key0", {"is_exact": True, "mismatches": 0, "values_compared": 9, "cycles_counted": {"depth": 7}}
    )


@cache
def sample() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sample.sqlite"
        write_sample(path)
        with sqlite3.connect(path) as connection:
            connection.execute("PRAGMA journal_mode = DELETE")
        connection.close()
        return path.read_bytes()


@st.composite
def statements(draw) -> tuple[str, tuple]:
    """One change of the rows, or of the tables."""
    table = draw(st.sampled_from(tuple(TABLES)))
    column = draw(st.sampled_from(TABLES[table]))
    value = draw(
        st.one_of(
            st.sampled_from(TEXTS), st.sampled_from((0, -1, 2**62, 1e300, float("inf"), b"\xff\x00", None))
        )
    )
    match draw(st.integers(0, 5)):
        case 0 | 1 | 2:
            return f"UPDATE OR REPLACE {table} SET {column} = ?", (value,)
        case 3:
            return f"ALTER TABLE {table} DROP COLUMN {column}", ()
        case 4:
            return f"DROP TABLE {table}", ()
        case _:
            return f"ALTER TABLE {table} RENAME COLUMN {column} TO other", ()


def edited(changes: list) -> "fuzzing.Content":
    def write(path: Path) -> None:
        path.write_bytes(sample())
        connection = sqlite3.connect(path)
        try:
            connection.execute("PRAGMA ignore_check_constraints = ON")
            for text, values in changes:
                try:
                    connection.execute(text, values)
                except sqlite3.Error:
                    continue
            connection.commit()
        finally:
            connection.close()

    return write


ROWS = st.lists(statements(), min_size=1, max_size=2).map(edited)
BYTES = st.deferred(lambda: changed_bytes([sample()]))


def read(folder: Path) -> None:
    """As `fastac trade` does."""
    path = folder / "results.sqlite"
    found = front.read(path)
    rows = [row for _, row in front.distinct([found])]
    front.faster(rows, "depth_mae_mm")
    shown = page.Trade([found], rows, {})
    try:
        page.tables(shown)
        best = front.pick(rows, "depth_mae_mm<1", ["latency_cycles"])
    except front.TradeError:  # the answer to a question: no such design is left
        return
    front.write_scene(best, folder / "picked.toml", "a test")


def resume(folder: Path) -> None:
    """As a `fastac sweep` does that goes on."""
    found = front.read(folder / "results.sqlite")
    found.results.trials()
    found.results.confirmations()


def command(folder: Path) -> list:
    return ["trade", folder / "results.sqlite", "-o", folder / fuzzing.OUTPUT]


READERS = [
    Reader(
        "sweep's results, rows",
        ROWS.map(lambda content: {"results.sqlite": content}),
        read,
        command,
        quick=20,
    ),
    Reader(
        "sweep's results, bytes",
        BYTES.map(lambda content: {"results.sqlite": content}),
        read,
        command,
        quick=20,
    ),
    Reader(
        "sweep's results, resumed", ROWS.map(lambda content: {"results.sqlite": content}), resume, quick=20
    ),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
