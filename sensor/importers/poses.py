"""The poses of a protocol as a CSV file: what a machine is told, and what it says it did.

    split, index, x_mm, y_mm, z_mm, load_n, tangential_x_n, tangential_y_n[, force_x_n, force_y_n, force_z_n]

One row per sample; x, y, z of the ball's lowest point in the sensor's axes, plus the machine's own origin if
it has one. As the machine is told, z is where the ball first touches the skin and the forces are what it has
to reach; in a recording z is where it stood, and the last three columns are what the gauge measured.
"""

import csv
import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from fastac.sensor.dataset import SPLITS
from fastac.sensor.importers.footage import ImportFailure
from fastac.store.files import write_atomically

MEASURED = ("force_x_n", "force_y_n", "force_z_n")


@dataclass(frozen=True)
class Pose:
    split: str
    index: int
    x_mm: float
    y_mm: float
    z_mm: float
    load_n: float
    tangential_x_n: float
    tangential_y_n: float
    force_x_n: float = math.nan
    force_y_n: float = math.nan
    force_z_n: float = math.nan

    @property
    def is_vertical(self) -> bool:
        return self.tangential_x_n == self.tangential_y_n == 0


COLUMNS = tuple(field.name for field in fields(Pose))


def write(path: Path, poses: Iterable[Pose]) -> None:
    """Write poses; the columns of measured forces only where there are any. The file appears whole."""
    poses = list(poses)
    measured = any(math.isfinite(pose.force_z_n) for pose in poses)
    columns = COLUMNS if measured else COLUMNS[: -len(MEASURED)]
    with write_atomically(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for pose in poses:
            row = astuple(pose)[: len(columns)]
            writer.writerow([f"{v + 0:.9g}" if isinstance(v, float) else v for v in row])


def read(path: Path, *, measured: bool) -> list[tuple[Pose, str]]:
    """Poses and, for errors, where each stands. `measured`: the columns of measured forces must be there.

    Raises ImportFailure on a missing or unknown column, a value that is none, or an index there twice.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            have = tuple(reader.fieldnames or ())
            for column in COLUMNS if measured else COLUMNS[: -len(MEASURED)]:
                if column not in have:
                    raise ImportFailure(f"{path}: {column}: missing column")
            for column in have:
                if column not in COLUMNS:
                    raise ImportFailure(f"{path}: {column}: unknown column: expected {', '.join(COLUMNS)}")
            rows = [(row, f"{path}, line {reader.line_num}") for row in reader]
    except FileNotFoundError:
        raise ImportFailure(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ImportFailure(f"{path}: not a readable CSV file: {error}") from None
    if not rows:
        raise ImportFailure(f"{path}: index: expected at least one row")
    poses, seen = [], set()
    for row, where in rows:
        pose = _pose(row, where)
        if pose.index in seen:
            raise ImportFailure(f"{where}: index = {pose.index}: there twice")
        seen.add(pose.index)
        poses.append((pose, where))
    return poses


def _pose(row: dict, where: str) -> Pose:
    values = {}
    for column, text in row.items():
        if column is None or text is None:
            raise ImportFailure(f"{where}: expected as many values as columns")
        try:
            values[column] = text.strip() if column == "split" else float(text)
        except ValueError:
            values[column] = math.nan
        if column != "split" and not math.isfinite(values[column]):
            raise ImportFailure(f"{where}: {column} = {text!r}: expected a number")
    if values["split"] not in SPLITS:
        raise ImportFailure(f"{where}: split = {values['split']!r}: expected one of {', '.join(SPLITS)}")
    if values["index"] != int(values["index"]) or values["index"] < 0:
        raise ImportFailure(f"{where}: index = {values['index']:g}: expected a whole number from 0")
    return Pose(**values | {"index": int(values["index"])})
