"""Rows of CSV files, checked against a dataclass whose fields name the columns and type their values.

A column has its field's name, or the one that the field's metadata says: field(metadata={COLUMN: "r (mm)"});
of several, (COLUMN: ("r", "r (mm)")), the first that the file has.
Every error is one line that names the file, the line, the column, the value, and what was expected.
"""

import csv
import math
from collections.abc import Iterable
from dataclasses import MISSING, Field, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import TypeAdapter, ValidationError

from fastac.sensor.importers.footage import ImportFailure

Row = TypeVar("Row")
Split = Literal["train", "validation", "test"]
"""The type of a column `split`: a name of a split of the dataset."""
COLUMN = "column"
"""Key of a field's metadata: the name of its column, where that is no name in Python, or names."""


def _column(field: Field, header: Iterable[str]) -> str:
    names = field.metadata.get(COLUMN, field.name)
    if isinstance(names, str):
        return names
    return next((name for name in names if name in header), names[0])


def where(path: Path, line: int) -> str:
    """How errors name a line of a file."""
    return f"{path}, line {line}"


def read_rows(
    path: Path, kind: type[Row], *, needed: Iterable[str] = (), others_allowed: bool = False
) -> list[tuple[Row, int]]:
    """The rows of a file as instances of the dataclass `kind`, each with its line number, at least one.

    Values are stripped of spaces around them; floats must be finite. A column may be absent where its field
    has a default and it is not `needed`. Other columns are ignored where `others_allowed`, else refused.

    Raises ImportFailure for files, columns and values that are missing, unknown or of another type.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            header = [name.strip() for name in reader.fieldnames or ()]
            reader.fieldnames = header
            _check_header(path, kind, header, set(needed), others_allowed)
            lines = [(values, reader.line_num) for values in reader]
    except FileNotFoundError:
        raise ImportFailure(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ImportFailure(f"{path}: not a readable CSV file: {error}") from None
    if not lines:
        raise ImportFailure(f"{path}: {header[0]}: expected at least one row")
    adapter = TypeAdapter(kind)
    return [(_row(adapter, kind, values, where(path, line)), line) for values, line in lines]


def _check_header(path: Path, kind: type, header: list[str], needed: set[str], others_allowed: bool) -> None:
    """Refuse columns that are named twice, missing, or unknown; a misspelt one is told as such."""
    known = [_column(field, header) for field in fields(kind)]
    needed |= {_column(field, header) for field in fields(kind) if field.default is MISSING}
    unknown = [column for column in header if column not in known]
    for column in header:
        if header.count(column) > 1:
            raise ImportFailure(f"{path}: {column}: column named twice")
    for column in known:
        if column in needed and column not in header:
            for misspelt in get_close_matches(column, unknown, n=1):
                raise ImportFailure(f"{path}: {misspelt!r}: unknown column; did you mean {column}?")
            raise ImportFailure(f"{path}: {column}: missing column")
    if unknown and not others_allowed:
        raise ImportFailure(f"{path}: {unknown[0]!r}: unknown column; expected {', '.join(known)}")


def _row(adapter: TypeAdapter, kind: type, values: dict, place: str):
    """One row as an instance of `kind`; `place` names its line."""
    columns = [column for column in values if column is not None]
    if None in values:
        count = len(columns) + len(values[None])
        raise ImportFailure(f"{place}: {count} values: expected {len(columns)}, one for each column")
    texts, named = {}, {field.name: _column(field, columns) for field in fields(kind)}
    for name, column in named.items():
        if column not in values:
            continue
        text = (values[column] or "").strip()
        if not text:
            raise ImportFailure(f"{place}: {column}: missing value")
        texts[name] = text
    try:
        row = adapter.validate_python(texts)
    except ValidationError as error:
        first = error.errors()[0]
        name, expected = str(first["loc"][0]), _expected(first)
        raise ImportFailure(f"{place}: {named[name]} = {texts[name]!r}: expected {expected}") from None
    for name, text in texts.items():
        value = getattr(row, name)
        if isinstance(value, float) and not math.isfinite(value):
            raise ImportFailure(f"{place}: {named[name]} = {text!r}: expected a number")
    return row


def _expected(error: dict) -> str:
    """What a value must be, in words, by the error that pydantic found in it."""
    if error["type"] == "literal_error":
        return "one of " + error["ctx"]["expected"].replace("'", "").replace(" or ", ", ")
    if error["type"] == "greater_than_equal":
        return f"at least {error['ctx']['ge']}"
    return "a whole number" if error["type"].startswith("int_") else "a number"
