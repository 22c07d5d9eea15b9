"""Imports calibration folders of gs_sdk, and of forks of gsrobotics with the same tools, as a dataset.

The layout is that of gs_sdk (GitHub, joehjhuang/gs_sdk, calibration/collect_data.py, label_data.py and
prepare_data.py); gsrobotics itself (gelsightinc/gsrobotics) has no tools that calibrate:

    catalog.csv                 experiment_reldir,diameter(mm): each press's folder and its ball's diameter
    background.png              the untouched gel
    4.000mm/0/gelsight.png      a press, named by its experiment_reldir; 8-bit RGB
    4.000mm/0/label.npz         center (x, y) and radius of the contact circle, px of the photograph
    train_test_split.json       optional: {"train": [experiment_reldir, …], "test": […]}

What else is in the folder is not read. Each press is a group of its own, by its experiment_reldir.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fastac.sensor.importers.contact_circles import (
    Press,
    every_fifth,
    photograph_in,
    write_presses,
)
from fastac.sensor.importers.csv_rows import COLUMN, read_rows, where
from fastac.sensor.importers.footage import ImportFailure, check_scale, file_in, one_line, photograph
from fastac.store.files import load_arrays, read_json

MOST_LABEL_BYTES = 1 << 16
SPLIT_FILE = "train_test_split.json"


@dataclass(frozen=True)
class CatalogRow:
    """One press: its folder below the calibration's, and the ball's diameter."""

    experiment_reldir: str
    diameter_mm: float = field(metadata={COLUMN: "diameter(mm)"})


def _circle(path: Path) -> tuple[float, float, float]:
    """The circle's center x, y and radius in a file label.npz, px. Raises ImportFailure for anything else."""
    with one_line(path):
        arrays = load_arrays(path, most_bytes=MOST_LABEL_BYTES)
    found = []
    for key, shape in (("center", (2,)), ("radius", ())):
        if key not in arrays:
            raise ImportFailure(f"{path}: {key}: missing array")
        value = arrays[key]
        if value.shape != shape or value.dtype.kind not in "iuf" or not np.isfinite(value).all():
            size = "two numbers" if shape else "a number"
            raise ImportFailure(f"{path}: {key} = {value.dtype} of shape {value.shape}: expected {size}")
        found += np.atleast_1d(value).tolist()
    return tuple(map(float, found))


def _split(folder: Path, names: list[str]) -> list[str]:
    """The split of each press by train_test_split.json; without that file every fifth is a test."""
    path = file_in(folder, SPLIT_FILE)
    if not path.exists():
        return every_fifth(len(names))
    with one_line(path):
        parts = read_json(path)
    of: dict[str, str] = {}
    for key in ("train", "test"):
        listed = parts.get(key) if isinstance(parts, dict) else None
        if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
            raise ImportFailure(f"{path}: {key}: expected a list of folders")
        for name in (name.replace("\\", "/") for name in listed):
            if of.setdefault(name, key) != key:
                raise ImportFailure(f"{path}: {name!r}: both in train and in test")
    for name in names:
        if name not in of:
            raise ImportFailure(f"{path}: {name!r}: in neither train nor test, though catalog.csv names it")
    return [of[name] for name in names]


def import_folder(
    folder: Path | str,
    *,
    px_per_mm: float,
    output: Path | str,
    skip_unlabelled: bool = False,
    **settings,
) -> None:
    """Import the labelled presses of a calibration folder (see above) into the dataset `output`.

    px_per_mm : 1 / ppmm of gs_sdk's configuration, whose ppmm is in mm per pixel (0.0634 for GelSight Mini at
        320 × 240 px)
    skip_unlabelled : leave presses without label.npz out, and count them, rather than refuse the folder
    settings : of `contact_circles.write_presses`: size, circles, progress

    What the dataset holds, sensor/importers/contact_circles.py says. Raises ImportFailure on anything
    missing, unreadable or inconsistent.
    """
    folder = Path(folder)
    check_scale(folder, "px_per_mm", px_per_mm)
    catalog = file_in(folder, "catalog.csv")
    found, left_out = [], 0
    for row, line in read_rows(catalog, CatalogRow, others_allowed=True):
        place, name = where(catalog, line), row.experiment_reldir.replace("\\", "/")
        check_scale(place, "diameter(mm)", row.diameter_mm)
        if any(name == press.group for press in found):
            raise ImportFailure(f"{place}: experiment_reldir = {name!r}: named twice")
        picture = photograph_in(folder, f"{name}/gelsight.png", place)
        label = file_in(folder, f"{name}/label.npz")
        if not label.is_file():
            if not skip_unlabelled:
                raise ImportFailure(f"{label}: no such file: the press has no circle (--skip-unlabelled)")
            left_out += 1
            continue
        found.append(Press.of_file(picture, str(label), *_circle(label), row.diameter_mm, "train", name))
    if not found:
        raise ImportFailure(f"{catalog}: experiment_reldir: none of {left_out} presses is labelled")
    split = _split(folder, [press.group for press in found])
    write_presses(
        [replace(press, split=part) for press, part in zip(found, split, strict=True)],
        photograph(file_in(folder, "background.png")),
        px_per_mm=px_per_mm,
        source=f"recorded: gs_sdk calibration {folder.resolve().name}",
        output=output,
        left_out=left_out,
        **settings,
    )
