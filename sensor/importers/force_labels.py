"""The labels of a recording with a force gauge: a CSV file with one row per frame.

frame       its index from 0 or, in a folder, its file name
force_z_n   or force_x_n, force_y_n and force_z_n; z is positive in compression
group       the recording or the object that the frame belongs to, what can be held out
split       optional: train, validation or test
"""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.sensor.importers.footage import ImportFailure, Photographs, Video
from fastac.sensor.samples import FORCE_AXES, SPLITS

COLUMNS = {axis: f"force_{axis}_n" for axis in FORCE_AXES}
BLOCKS, VALIDATION_BLOCKS = 10, (3, 8)
"""Neighbouring frames look alike, so a validation split takes whole stretches: these of each group's ten."""


@dataclass(frozen=True, eq=False)
class Labels:
    """The rows in the order of their frames: frame (rows,) indices; force_n (rows, axes); group, split text.

    lines : the file's line of each row, for errors; split is None where the file has no such column
    """

    path: Path
    axes: tuple[str, ...]
    lines: np.ndarray
    frame: np.ndarray
    force_n: np.ndarray
    group: np.ndarray
    split: np.ndarray | None

    def where(self, row: int) -> str:
        return f"{self.path}, line {self.lines[row]}"

    @property
    def groups(self) -> list[str]:
        """The groups' names, in the order in which they appear."""
        return list(dict.fromkeys(self.group.tolist()))


def split_by_group(group: np.ndarray, held_out: tuple[str, ...]) -> np.ndarray:
    """A split (frames,) in which the groups `held_out` are the test.

    Of each other group, two stretches of neighbouring frames, a fifth in all, are the validation.
    """
    split = np.full(len(group), "train", dtype="U10")
    for name in dict.fromkeys(group.tolist()):
        index = np.flatnonzero(group == name)
        block = np.arange(len(index)) * BLOCKS // len(index)
        split[index[np.isin(block, VALIDATION_BLOCKS)]] = "validation"
        if name in held_out:
            split[index] = "test"
    return split


def _axes(path: Path, header: list[str]) -> tuple[str, ...]:
    """The axes of force in a header whose columns are all there and known."""
    axes = tuple(axis for axis, column in COLUMNS.items() if column in header)
    expected = {"frame", "group", *COLUMNS.values(), "split"}
    for column in header:
        if column not in expected:
            raise ImportFailure(
                f"{path}: {column!r}: unknown column; expected frame, group, force_z_n or all of"
                f" {', '.join(COLUMNS.values())}, and maybe split"
            )
        if header.count(column) > 1:
            raise ImportFailure(f"{path}: {column}: column named twice")
    needed = ["frame", *(COLUMNS[axis] for axis in (FORCE_AXES if len(axes) > 1 else "z")), "group"]
    for column in needed:
        if column not in header:
            raise ImportFailure(f"{path}: {column}: missing column")
    return axes


def _row(row: dict, where: str) -> dict:
    """A row with its values stripped and its numbers converted."""
    if None in row:
        raise ImportFailure(f"{where}: {len(row) - 1 + len(row[None])} values: expected {len(row) - 1}")
    converted = {}
    for column, value in row.items():
        if value is None or not value.strip():
            raise ImportFailure(f"{where}: {column}: missing value")
        converted[column] = value.strip()
        if column in COLUMNS.values():
            try:
                converted[column] = float(value)
            except ValueError:
                converted[column] = math.nan
            if not math.isfinite(converted[column]):
                raise ImportFailure(f"{where}: {column} = {value!r}: expected a number")
    if converted.get("split", "train") not in SPLITS:
        raise ImportFailure(f"{where}: split = {converted['split']!r}: expected one of {', '.join(SPLITS)}")
    return converted


def _index(value: str, frames: Photographs | Video, where: str) -> int:
    """Which frame a value of the column `frame` means."""
    if value.isascii() and value.isdigit():
        return int(value)
    index = frames.index_of(value)
    if index is None:
        expected = (
            "an index from 0" if isinstance(frames, Video) else f"an index from 0 or a file in {frames.path}"
        )
        raise ImportFailure(f"{where}: frame = {value!r}: expected {expected}")
    return index


def read(path: Path, frames: Photographs | Video) -> Labels:
    """The labels in a file; raises ImportFailure on what is missing, unknown, named twice or not a number."""
    rows, lines = [], []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            axes = _axes(path, list(reader.fieldnames or ()))
            for row in reader:
                lines.append(reader.line_num)
                rows.append(_row(row, f"{path}, line {reader.line_num}"))
    except FileNotFoundError:
        raise ImportFailure(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ImportFailure(f"{path}: not a readable CSV file: {error}") from None
    if not rows:
        raise ImportFailure(f"{path}: frame: expected at least one row")
    frame = np.array(
        [_index(row["frame"], frames, f"{path}, line {n}") for row, n in zip(rows, lines, strict=True)]
    )
    order = np.argsort(frame, kind="stable")
    labels = Labels(
        path,
        axes,
        np.array(lines)[order],
        frame[order],
        np.array([[row[COLUMNS[axis]] for axis in axes] for row in rows], np.float64)[order],
        np.array([row["group"] for row in rows])[order],
        np.array([row["split"] for row in rows])[order] if "split" in rows[0] else None,
    )
    twice = np.flatnonzero(np.diff(labels.frame) == 0)
    if len(twice):
        raise ImportFailure(f"{labels.where(twice[0] + 1)}: frame = {labels.frame[twice[0]]}: named twice")
    low, high = labels.force_n[:, -1].min(), labels.force_n[:, -1].max()
    if -low > high:
        raise ImportFailure(
            f"{path}: force_z_n = {low:g} to {high:g}: expected positive values in compression"
        )
    return labels
