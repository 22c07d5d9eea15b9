"""Imports photographs of ball presses, with labelled contact circles, as a dataset.

The labels are a CSV file with columns image, center_x_px, center_y_px, radius_px, split (train, validation
or test), in pixel indices of the original photographs. Inside the circle the skin touches the ball, so its
normals are known. Outside it the gel forms a shoulder that was not measured: its pixels are not valid, and
their normals are NaN. The background is the one sample of flat skin; it is stored last, in split train.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.sensor import dataset
from fastac.sensor.geometry import ball_slopes, normals_from_slopes
from fastac.sensor.importers.csv_rows import Split, read_rows, where
from fastac.sensor.importers.footage import CHANNELS, ImportFailure, file_in, photograph
from fastac.sensor.importers.resample import Resampling


@dataclass(frozen=True)
class Label:
    """A photograph and the circle in which ball and gel touch, in pixels of the photograph."""

    image: str
    center_x_px: float
    center_y_px: float
    radius_px: float
    split: Split


def _check_circle(
    label: Label, place: str, height: int, width: int, ball_mm: float, px_per_mm: float
) -> None:
    """Raise ImportFailure for a circle larger than the ball or beyond the image; `place` names its line."""
    radius = label.radius_px
    if radius <= 0:
        raise ImportFailure(f"{place}: radius_px = {radius:g}: expected more than 0")
    if radius / px_per_mm >= ball_mm / 2:
        raise ImportFailure(
            f"{place}: radius_px = {radius:g}: {radius / px_per_mm:.3f} mm at {px_per_mm:g} px/mm,"
            f" expected less than the ball's radius of {ball_mm / 2:g} mm"
        )
    for key, size in (("center_x_px", width), ("center_y_px", height)):
        value = getattr(label, key)
        if not radius - 0.5 <= value <= size - 0.5 - radius:
            raise ImportFailure(
                f"{place}: {key} = {value:g}: a circle of radius {radius:g} px leaves the image of {size} px"
            )


def _inside(center_px, radius_px, pitch_mm: float, ball_mm: float, shape: tuple[int, int]):
    """Where the skin lies against the ball, bool (H, W), and its normals there (n, 3)."""
    v, u = np.indices(shape)
    x, y = (u - center_px[0]) * pitch_mm, (v - center_px[1]) * pitch_mm
    inside = np.hypot(x, y) <= radius_px * pitch_mm
    return inside, normals_from_slopes(*ball_slopes(x[inside], y[inside], ball_mm))


def import_folder(
    folder: Path | str,
    labels: Path | str,
    background: Path | str,
    *,
    ball_mm: float,
    px_per_mm: float,
    output: Path | str,
    height_px: int = 128,
    width_px: int = 128,
) -> None:
    """Import the presses that `labels` lists from `folder` into the dataset `output`.

    Photographs are padded to the target's aspect by the background and resampled by exact area averaging,
    so the pitch is (original px per resampled px) / px_per_mm. `indenter` holds, per sample: center_px
    (u, v) and radius_px in resampled pixels, ball_mm, and scale, the original pixels per resampled one;
    center, radius and ball are NaN for the flat sample.

    Raises ImportFailure on anything missing, unreadable or inconsistent.
    """
    folder, labels, background = Path(folder), Path(labels), Path(background)
    for key, value in (("ball_mm", ball_mm), ("px_per_mm", px_per_mm)):
        if not (math.isfinite(value) and value > 0):
            raise ImportFailure(f"{folder}: {key} = {value:g}: expected more than 0")
    rows = read_rows(labels, Label, others_allowed=True)
    untouched = photograph(background)
    resampling = Resampling(*untouched.shape[:2], height_px, width_px)
    pitch_mm = resampling.scale / px_per_mm
    shape = (height_px, width_px)
    n = len(rows) + 1

    frames = np.empty((n, *shape, len(CHANNELS)), np.uint8)
    normals = np.full((n, *shape, 3), np.nan, np.float32)
    valid = np.zeros((n, *shape), bool)
    center_px = np.full((n, 2), np.nan)
    radius_px = np.full(n, np.nan)
    in_photograph = resampling.valid()
    for i, (label, line) in enumerate(rows):
        place = where(labels, line)
        try:
            path = file_in(folder, label.image)
        except ImportFailure:
            raise ImportFailure(f"{place}: image = {label.image!r}: not inside {folder}") from None
        if not path.is_file():
            raise ImportFailure(f"{place}: image = {label.image!r}: not in {folder}")
        image = photograph(path)
        if image.shape != untouched.shape:
            raise ImportFailure(
                f"{path}: size = {image.shape[1]} x {image.shape[0]} px:"
                f" expected the background's {untouched.shape[1]} x {untouched.shape[0]}"
            )
        _check_circle(label, place, *untouched.shape[:2], ball_mm, px_per_mm)
        frames[i] = np.rint(resampling.frame(image, untouched))
        center_px[i] = resampling.points_px(np.array([label.center_x_px, label.center_y_px]))
        radius_px[i] = label.radius_px / resampling.scale
        inside, inside_normals = _inside(center_px[i], radius_px[i], pitch_mm, ball_mm, shape)
        valid[i] = inside & in_photograph
        normals[i][inside] = inside_normals
        normals[i][~valid[i]] = np.nan

    frames[-1] = np.rint(resampling.background(untouched))
    normals[-1][in_photograph] = (0, 0, 1)
    valid[-1] = in_photograph

    dataset.write(
        output,
        pitch_mm=pitch_mm,
        channels=CHANNELS,
        source=f"recorded: ball presses from {folder.name}",
        background=frames[-1],
        frames=frames,
        split=np.array([*(label.split for label, _ in rows), "train"]),
        normals=normals,
        valid=valid,
        photograph_px=untouched.shape[:2],
        indenter={
            "center_px": center_px,
            "radius_px": radius_px,
            "ball_mm": np.array([ball_mm] * (n - 1) + [np.nan]),
            "scale": np.full(n, resampling.scale),
        },
    )
