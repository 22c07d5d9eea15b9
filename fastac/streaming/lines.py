"""Records as lines of text, for shells: JSON or the columns of a table, with shapes in place of arrays."""

import csv
import io
import json
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from fastac.streaming.about import About
from fastac.streaming.record import SCALARS, TIMES, StreamRecord

FLAGS = ("lost", "bad", "suspect", "slipping")
Row = Callable[[StreamRecord], str]


def of_about(about: About) -> str:
    """The stream's description as a line of JSON."""
    return json.dumps({**asdict(about), "units": about.units})


def json_lines(about: About, *, digests: bool) -> tuple[str | None, Row]:
    """No heading, and what makes a record an object of JSON. digests : with `digest`, the record's SHA-256"""

    def row(record: StreamRecord) -> str:
        content: dict[str, Any] = {name: getattr(record, name) for name in SCALARS}
        content["arrays"] = {name: array.shape for name, array in record.arrays.items()}
        content |= {"errors": record.errors, "timing": vars(record.timing)}
        if digests:
            content["digest"] = record.digest
        return json.dumps(content)

    return None, row


def csv_lines(about: About, *, digests: bool) -> tuple[str | None, Row]:
    """The names of the columns, and what makes a record a line: flags as 0 and 1, names with spaces."""
    forces = [f"force_{axis}_{unit}" for axis in about.force_axes for unit in ("n", "raw")]
    columns = [
        "frame",
        "source_time_ns",
        *FLAGS,
        *forces,
        "slip_px",
        "slip_dots",
        *TIMES,
        "reasons",
        "errors",
    ]
    columns += ["digest"] * digests

    def row(record: StreamRecord) -> str:
        content = {name: getattr(record, name) for name in (*SCALARS, "errors")} | vars(record.timing)
        content |= {name: int(content[name]) for name in FLAGS}
        content |= {name: " ".join(content[name]) for name in ("reasons", "errors")}
        for unit in ("n", "raw"):
            found = content[f"force_{unit}"]
            content |= {f"force_{axis}_{unit}": found.get(axis) for axis in about.force_axes}
        if digests:
            content["digest"] = record.digest
        return _line([content[name] for name in columns])

    return _line(columns), row


def _line(values: list) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(values)
    return text.getvalue()


FORMS = {"json": json_lines, "csv": csv_lines}
