"""The poses of a protocol as a CSV file: those that a machine shall reach, or those that it recorded.

    split, index, x_mm, y_mm, z_mm, load_n, tangential_x_n, tangential_y_n[, force_x_n, force_y_n, force_z_n]

One row per sample; x, y, z of the ball's lowest point along the sensor's axes, relative to the machine's
origin. In a plan, z is where the ball first touches the skin, and the forces are those to reach. In a
recording, z is where the ball stood, and the last three columns are what the gauge measured.
"""

import csv
import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Annotated

from pydantic import Field

from fastac.sensor.importers.csv_rows import Split, read_rows, where
from fastac.sensor.importers.footage import ImportFailure
from fastac.store.files import write_atomically

MEASURED = ("force_x_n", "force_y_n", "force_z_n")


@dataclass(frozen=True)
class Pose:
    """One sample: position of the ball's lowest point (mm), forces to reach and forces measured (N)."""

    split: Split
    index: Annotated[int, Field(ge=0)]
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
    """The poses of a file and, for errors, its name with the line of each.

    measured : whether the columns of measured forces are required

    Raises ImportFailure on a missing or unknown column, a value of another type, or an index named twice.
    """
    poses, seen = [], set()
    for pose, line in read_rows(path, Pose, needed=MEASURED if measured else ()):
        place = where(path, line)
        if pose.index in seen:
            raise ImportFailure(f"{place}: index = {pose.index}: named twice")
        seen.add(pose.index)
        poses.append((pose, place))
    return poses
