"""Imports the ball presses of a FOTS calibration as a dataset.

The layout is that of FOTS (GitHub, Rancho-zhao/FOTS, mlp_calib and its scripts/label_data.py):

    csv/annotate.csv     img_names,center_x,center_y,radius, px; names are paths of the machine that labelled
    gelsight/0001.png    the photograph that …/gelsight/0001.png names: the last two parts of its path count
    0000.png             the untouched gel

Folders of digit-depth (GitHub, vocdex/digit-depth) are the same, with a column img_name and the untouched gel
elsewhere. A photograph that is labelled twice has the later circle. Each press is a group of its own, by its
file.
"""

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from fastac.sensor.importers.contact_circles import (
    Press,
    photograph_in,
    splits_of,
    write_presses,
)
from fastac.sensor.importers.csv_rows import COLUMN, read_rows, where
from fastac.sensor.importers.footage import check_scale, file_in, photograph


@dataclass(frozen=True)
class Annotation:
    """A photograph's path on the machine that labelled it, and its circle, px."""

    img_names: str = field(metadata={COLUMN: ("img_names", "img_name")})
    center_x_px: float = field(metadata={COLUMN: "center_x"})
    center_y_px: float = field(metadata={COLUMN: "center_y"})
    radius_px: float = field(metadata={COLUMN: "radius"})


def import_folder(
    folder: Path | str,
    *,
    ball_mm: float,
    px_per_mm: float,
    output: Path | str,
    background: str = "0000.png",
    held_out: tuple[str, ...] = (),
    **settings,
) -> None:
    """Import the annotated presses of a folder mlp_calib (see above) into the dataset `output`.

    background : the photograph of the untouched gel, a name in the folder
    held_out : presses of the test split, by their groups' names such as gelsight/0004.png; without it every
        fifth press is, for the layout has no split
    settings : of `contact_circles.write_presses`: size, circles, progress

    What the dataset holds, sensor/importers/contact_circles.py says. Raises ImportFailure on anything
    missing, unreadable or inconsistent.
    """
    folder = Path(folder)
    check_scale(folder, "ball_mm", ball_mm)
    check_scale(folder, "px_per_mm", px_per_mm)
    table = file_in(folder, "csv/annotate.csv")
    latest = {}
    for row, line in read_rows(table, Annotation, others_allowed=True):
        parts = PurePosixPath(row.img_names.replace("\\", "/")).parts
        latest["/".join(parts[-2:])] = row, where(table, line)
    names = sorted(latest)
    presses = []
    for name, split in zip(names, splits_of(table, names, held_out), strict=True):
        row, place = latest[name]
        circle = row.center_x_px, row.center_y_px, row.radius_px
        path = photograph_in(folder, name, place)
        presses.append(Press.of_file(path, place, *circle, ball_mm, split, name))
    write_presses(
        presses,
        photograph(file_in(folder, background)),
        px_per_mm=px_per_mm,
        source=f"recorded: FOTS calibration {folder.resolve().name}",
        output=output,
        **settings,
    )
