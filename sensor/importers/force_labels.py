"""The labels of a recording with a force gauge: a CSV file with one row per frame.

frame       its index from 0 or, in a folder, its file name
force_z_n   or force_x_n, force_y_n and force_z_n; z is positive in compression
group       the recording or the object that the frame belongs to; it can be held out as a whole
split       optional: train, validation or test
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.sensor.importers.csv_rows import Split, read_rows, where
from fastac.sensor.importers.footage import ImportFailure, Photographs, Video
from fastac.sensor.samples import FORCE_AXES

COLUMNS = {axis: f"force_{axis}_n" for axis in FORCE_AXES}
LONGEST_INDEX = 9
"""Digits of a frame's index: no recording has more frames."""
BLOCKS, VALIDATION_BLOCKS = 10, (3, 8)
"""Validation takes whole stretches of frames, since neighbours look alike: these two of each group's ten."""
LARGEST_PULL = 0.05
"""Share of a recording's largest F_z, in compression, by which it may be negative: a gauge's zero drifts."""


@dataclass(frozen=True)
class Label:
    """One row of the file: a frame and the forces on it, N."""

    frame: str
    force_z_n: float
    group: str
    force_x_n: float | None = None
    force_y_n: float | None = None
    split: Split | None = None


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
        return where(self.path, self.lines[row])

    @property
    def groups(self) -> list[str]:
        """The groups' names, in the order in which they appear."""
        return list(dict.fromkeys(self.group.tolist()))


def split_by_group(group: np.ndarray, held_out: tuple[str, ...]) -> np.ndarray:
    """The split of each frame, (frames,) text: the groups `held_out` are the test split.

    Two stretches of neighbouring frames of each other group, a fifth of it, are the validation split.
    """
    split = np.full(len(group), "train", dtype="U10")
    for name in dict.fromkeys(group.tolist()):
        index = np.flatnonzero(group == name)
        block = np.arange(len(index)) * BLOCKS // len(index)
        split[index[np.isin(block, VALIDATION_BLOCKS)]] = "validation"
        if name in held_out:
            split[index] = "test"
    return split


def known_groups(origin: Path | str, group: np.ndarray, held_out: tuple[str, ...]) -> list[str]:
    """The names of the groups of the frames, in order. Raises ImportFailure for groups that are not there."""
    groups = list(dict.fromkeys(group.tolist()))
    for name in held_out:
        if name not in groups:
            raise ImportFailure(f"{origin}: group {name!r}: expected one of {', '.join(groups)}")
    return groups


def split_held_out(
    origin: Path | str, group: np.ndarray, held_out: tuple[str, ...], advice: str = ""
) -> np.ndarray:
    """The split of each frame where the groups `held_out` are the test split, or else the last one.

    Raises ImportFailure, which begins with `origin`, for groups that are not there and where nothing is left
    to test or to train on; `advice` says what helps where there is one group alone.
    """
    groups = known_groups(origin, group, held_out)
    if len(groups) == 1:
        raise ImportFailure(
            f"{origin}: group = {groups[0]!r} in every row: nothing can be held out{advice and '; '}{advice}"
        )
    if len(set(held_out)) == len(groups):
        raise ImportFailure(f"{origin}: group: all {len(groups)} are held out, none is left to train on")
    return split_by_group(group, held_out or (groups[-1],))


def check_compression(origin: Path | str, force_n: np.ndarray) -> None:
    """Raise ImportFailure where z, the last axis of forces (frames, axes), is negative in compression.

    Large forces decide, by their squares, and not the largest: a gauge may have a few wrong readings.
    """
    z_n = force_n[:, -1].astype(float)
    if (z_n * np.abs(z_n)).sum() < 0:
        raise ImportFailure(
            f"{origin}: force_z_n = {z_n.min():g} to {z_n.max():g}, mostly negative where it is large:"
            " expected positive values in compression (--negate, where a command has it, turns them)"
        )


def largest_pull_n(force_n: np.ndarray) -> float:
    """How far below zero the z of forces (frames, axes) may be in N; beyond, it is not the skin's.

    Objects press on a skin and do not pull it. A gauge can be pulled all the same, as by a gripper that opens
    until it hits its end.
    """
    return LARGEST_PULL * max(float(force_n[:, -1].max()), 0.0)


def _index(value: str, frames: Photographs | Video, place: str) -> int:
    """The index of the frame that a value of the column `frame` names."""
    if value.isascii() and value.isdigit() and len(value) <= LONGEST_INDEX:
        return int(value)
    index = frames.index_of(value)
    if index is None:
        expected = (
            "an index from 0" if isinstance(frames, Video) else f"an index from 0 or a file in {frames.path}"
        )
        raise ImportFailure(f"{place}: frame = {value!r}: expected {expected}")
    return index


def read(path: Path, frames: Photographs | Video, *, negate: bool = False) -> Labels:
    """The labels in a file.

    negate : for gauges whose z is negative in compression

    Raises ImportFailure on columns and values that are missing, unknown or of another type, on frames named
    twice, and on forces whose sign is not that of compression.
    """
    found, sign = read_rows(path, Label), -1 if negate else 1
    axes = tuple(axis for axis, column in COLUMNS.items() if getattr(found[0][0], column) is not None)
    for axis in FORCE_AXES:
        if len(axes) > 1 and axis not in axes:
            raise ImportFailure(f"{path}: {COLUMNS[axis]}: missing column")
    frame = np.array([_index(label.frame, frames, where(path, line)) for label, line in found])
    order = np.argsort(frame, kind="stable")
    rows = [found[k][0] for k in order]
    labels = Labels(
        path,
        axes,
        np.array([line for _, line in found])[order],
        frame[order],
        sign * np.array([[getattr(row, COLUMNS[axis]) for axis in axes] for row in rows], np.float64),
        np.array([row.group for row in rows]),
        None if rows[0].split is None else np.array([row.split for row in rows]),
    )
    twice = np.flatnonzero(np.diff(labels.frame) == 0)
    if len(twice):
        raise ImportFailure(f"{labels.where(twice[0] + 1)}: frame = {labels.frame[twice[0]]}: named twice")
    check_compression(path, labels.force_n)
    return labels
