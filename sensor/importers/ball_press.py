"""Imports photographs of ball presses, with labelled contact circles, as a dataset.

The labels are a CSV file with columns image, center_x_px, center_y_px, radius_px, split (train, validation
or test), in pixel indices of the original photographs.
"""

from dataclasses import dataclass
from pathlib import Path

from fastac.sensor.importers.contact_circles import Press, photograph_in, write_presses
from fastac.sensor.importers.csv_rows import Split, read_rows, where
from fastac.sensor.importers.footage import check_scale, photograph


@dataclass(frozen=True)
class Label:
    """A photograph and the circle in which ball and gel touch, in pixels of the photograph."""

    image: str
    center_x_px: float
    center_y_px: float
    radius_px: float
    split: Split


def import_folder(
    folder: Path | str,
    labels: Path | str,
    background: Path | str,
    *,
    ball_mm: float,
    px_per_mm: float,
    output: Path | str,
    **settings,
) -> None:
    """Import the presses that `labels` lists from `folder` into the dataset `output`.
    settings : of `contact_circles.write_presses`: size, circles, progress

    What the dataset holds, sensor/importers/contact_circles.py says. Raises ImportFailure on anything
    missing, unreadable or inconsistent.
    """
    folder, labels = Path(folder), Path(labels)
    check_scale(folder, "ball_mm", ball_mm)
    check_scale(folder, "px_per_mm", px_per_mm)
    presses = []
    for label, line in read_rows(labels, Label, others_allowed=True):
        place = where(labels, line)
        circle = label.center_x_px, label.center_y_px, label.radius_px
        path = photograph_in(folder, label.image, place)
        presses.append(Press.of_file(path, place, *circle, ball_mm, label.split))
    write_presses(
        presses,
        photograph(Path(background)),
        px_per_mm=px_per_mm,
        source=f"recorded: ball presses from {folder.name}",
        output=output,
        **settings,
    )
