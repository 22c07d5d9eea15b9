"""The results of a sweep: one SQLite file. A point is there whole or not at all, whatever interrupts."""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

SCHEMA = """
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS points (
    key TEXT PRIMARY KEY,
    status TEXT NOT NULL CHECK (status IN ('done', 'infeasible', 'failed')),
    axes TEXT NOT NULL,
    scene TEXT,
    metrics TEXT NOT NULL,
    error TEXT NOT NULL,
    seconds REAL NOT NULL,
    generation TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS trials (number INTEGER PRIMARY KEY, choice TEXT NOT NULL, key TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS confirmations (key TEXT PRIMARY KEY, content TEXT NOT NULL);
"""
FORMAT_VERSION = "1"
WAIT_S = 60
"""For another process that is writing."""


class ResultsError(ValueError):
    """Results that cannot be used; the message is one line that names the file."""


@dataclass(frozen=True)
class Row:
    """A point: `axes` and `scene` as JSON content, `metrics` by name; `error` says why there are none.

    infeasible : no hardware can be made of the scene, which stays so; failed : something else went wrong
    """

    key: str
    status: str
    axes: dict
    scene: dict | None
    metrics: dict[str, float] = field(default_factory=dict)
    error: str = ""
    seconds: float = 0.0
    generation: str = ""
    """Of code, data and frames: points of different ones are not to be compared."""


class Results:
    """Points, confirmations and Optuna's trials in a file, which is made if it is not there."""

    def __init__(self, path: Path, *, create: bool = True):
        if not create and not path.is_file():
            raise ResultsError(f"{path}: no such file; `fastac sweep` writes results")
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with self._connection() as connection:
                # Readers then see whole points while another process writes; a kill loses no finished one.
                connection.execute("PRAGMA journal_mode = WAL")
                connection.executescript(SCHEMA)
        except sqlite3.DatabaseError as error:
            raise ResultsError(f"{path}: no results of a sweep: {error}") from None
        version = self.facts().get("format_version", FORMAT_VERSION)
        if version != FORMAT_VERSION:
            raise ResultsError(f"{path}: format_version = {version!r}: expected {FORMAT_VERSION!r}")
        self.set_facts({"format_version": FORMAT_VERSION})

    @contextmanager
    def _connection(self) -> Iterator[sqlite3.Connection]:
        """A connection whose changes become one transaction."""
        connection = sqlite3.connect(self.path, timeout=WAIT_S)
        try:
            with connection:
                yield connection
        finally:
            connection.close()

    def facts(self) -> dict:
        with self._connection() as connection:
            rows = connection.execute("SELECT name, value FROM facts").fetchall()
        return {name: json.loads(value) for name, value in rows}

    def set_facts(self, facts: dict) -> None:
        with self._connection() as connection:
            connection.executemany(
                "INSERT OR REPLACE INTO facts VALUES (?, ?)", [(k, json.dumps(v)) for k, v in facts.items()]
            )

    def add(self, row: Row) -> None:
        scene = None if row.scene is None else json.dumps(row.scene)
        axes, metrics = json.dumps(row.axes), json.dumps(row.metrics)
        values = (row.key, row.status, axes, scene, metrics, row.error, row.seconds, row.generation)
        with self._connection() as connection:
            connection.execute("INSERT OR REPLACE INTO points VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)

    def rows(self, generation: str | None = None) -> list[Row]:
        """All points, or those of a generation, in the order in which they were added."""
        columns = "key, status, axes, scene, metrics, error, seconds, generation"
        with self._connection() as connection:
            rows = connection.execute(f"SELECT {columns} FROM points ORDER BY rowid").fetchall()
        found = [
            Row(key, status, json.loads(axes), scene and json.loads(scene), json.loads(metrics), *rest)
            for key, status, axes, scene, metrics, *rest in rows
        ]
        return [row for row in found if generation in (None, row.generation)]

    def add_trial(self, choice: dict, key: str) -> None:
        with self._connection() as connection:
            connection.execute("INSERT INTO trials (choice, key) VALUES (?, ?)", (json.dumps(choice), key))

    def trials(self) -> list[tuple[dict, str]]:
        """Choices and keys of points, in the order in which they were told."""
        with self._connection() as connection:
            rows = connection.execute("SELECT choice, key FROM trials ORDER BY number").fetchall()
        return [(json.loads(choice), key) for choice, key in rows]

    def confirm(self, key: str, content: dict) -> None:
        with self._connection() as connection:
            connection.execute(
                "INSERT OR REPLACE INTO confirmations VALUES (?, ?)", (key, json.dumps(content))
            )

    def confirmations(self) -> dict[str, dict]:
        with self._connection() as connection:
            rows = connection.execute("SELECT key, content FROM confirmations ORDER BY rowid").fetchall()
        return {key: json.loads(content) for key, content in rows}
