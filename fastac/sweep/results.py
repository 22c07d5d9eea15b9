"""The results of a sweep in one SQLite file; an interruption loses no point that was added."""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

Content = TypeVar("Content")
SHOWN = 60
"""Characters of a damaged value that errors show."""
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
"""How long to wait for another process that is writing."""


class ResultsError(ValueError):
    """Results that cannot be used; the message is one line that names the file."""


@dataclass(frozen=True)
class Row:
    """One point of a sweep.

    status : "done"; "infeasible", where no hardware can be made of the scene; or "failed", for other errors
    axes, scene : the chosen values and the whole scene, as JSON content
    metrics : errors, cycles, resources and energy by name; where there are none, `error` says why
    seconds : how long the measurement took
    """

    key: str
    status: str
    axes: dict
    scene: dict | None
    metrics: dict[str, float] = field(default_factory=dict)
    error: str = ""
    seconds: float = 0.0
    generation: str = ""
    """A hash of code, data and frames: only points of equal generation can be compared."""


class Results:
    """A results file: points, RTL confirmations and Optuna's trials; created where it does not exist."""

    def __init__(self, path: Path, *, create: bool = True):
        if not create and not path.is_file():
            raise ResultsError(f"{path}: no such file; `fastac sweep` writes results")
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        with self._connection() as connection:
            # Readers then see whole points while another process writes; a kill loses no finished one.
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(SCHEMA)
        version = self.facts().get("format_version", FORMAT_VERSION)
        if version != FORMAT_VERSION:
            raise ResultsError(f"{path}: format_version = {version!r}: expected {FORMAT_VERSION!r}")
        self.set_facts({"format_version": FORMAT_VERSION})

    @contextmanager
    def _connection(self) -> Iterator[sqlite3.Connection]:
        """A connection whose changes are one transaction, committed at the end of the block.

        Raises ResultsError where the file is no SQLite file, is damaged, or has other tables.
        """
        try:
            connection = sqlite3.connect(self.path, timeout=WAIT_S)
            try:
                with connection:
                    yield connection
            finally:
                connection.close()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            reason = " ".join(str(error).split())  # SQLite quotes the tables' text, line by line
            raise ResultsError(f"{self.path}: no results of a sweep: {reason}") from None

    def _content(self, text: object, place: str, kind: type[Content]) -> Content:
        """What a cell's JSON says. Raises ResultsError, which names `place`, for anything but a `kind`."""
        try:
            found = json.loads(text)
        except (TypeError, ValueError, RecursionError) as error:
            raise ResultsError(f"{self.path}: {place}: damaged ({error})") from None
        if not isinstance(found, kind):
            raise ResultsError(f"{self.path}: {place} = {str(text)[:SHOWN]!r}: expected {kind.__name__}")
        return found

    def facts(self) -> dict:
        """What all points have in common, by name: base scene, settings, origins of the figures."""
        with self._connection() as connection:
            rows = connection.execute("SELECT name, value FROM facts").fetchall()
        return {str(name): self._content(value, f"fact {name!r}", object) for name, value in rows}

    def set_facts(self, facts: dict) -> None:
        """Add facts, or replace those of the same name."""
        with self._connection() as connection:
            connection.executemany(
                "INSERT OR REPLACE INTO facts VALUES (?, ?)", [(k, json.dumps(v)) for k, v in facts.items()]
            )

    def add(self, row: Row) -> None:
        """Add a point, or replace the one of the same key."""
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
        found = [self._row(row) for row in rows]
        return [row for row in found if generation in (None, row.generation)]

    def _row(self, cells: tuple) -> Row:
        """Raises ResultsError unless the cells of a point are of its fields' types."""
        key, status, axes, scene, metrics, error, seconds, generation = cells
        place = f"point {key!r}"
        for name, value, kind in (
            ("key", key, str),
            ("status", status, str),
            ("error", error, str),
            ("seconds", seconds, float),
            ("generation", generation, str),
        ):
            if not isinstance(value, kind):
                raise ResultsError(f"{self.path}: {place}: {name} = {value!r}: expected {kind.__name__}")
        found = Row(
            key,
            status,
            self._content(axes, f"{place}: axes", dict),
            None if scene is None else self._content(scene, f"{place}: scene", dict),
            self._content(metrics, f"{place}: metrics", dict),
            error,
            seconds,
            generation,
        )
        for name, value in found.metrics.items():
            if type(value) not in (int, float):
                raise ResultsError(f"{self.path}: {place}: {name} = {value!r}: expected a number")
        return found

    def add_trial(self, choice: dict, key: str) -> None:
        """Record that the optimiser chose the axes `choice`, whose point has this key."""
        with self._connection() as connection:
            connection.execute("INSERT INTO trials (choice, key) VALUES (?, ?)", (json.dumps(choice), key))

    def trials(self) -> list[tuple[dict, str]]:
        """Choices of the optimiser and the keys of their points, in the order in which they were recorded."""
        with self._connection() as connection:
            rows = connection.execute("SELECT choice, key FROM trials ORDER BY number").fetchall()
        return [(self._content(choice, "trial", dict), key) for choice, key in rows]

    def confirm(self, key: str, content: dict) -> None:
        """Record what the RTL simulation of a point found."""
        with self._connection() as connection:
            connection.execute(
                "INSERT OR REPLACE INTO confirmations VALUES (?, ?)", (key, json.dumps(content))
            )

    def confirmations(self) -> dict[str, dict]:
        """What RTL simulations found, by the keys of their points."""
        with self._connection() as connection:
            rows = connection.execute("SELECT key, content FROM confirmations ORDER BY rowid").fetchall()
        return {key: self._content(content, f"confirmation {key!r}", dict) for key, content in rows}
