"""Photographs of balls pressed onto a flat gel, each with the circle of its contact, as a dataset.

Inside the circle the skin touches the ball, so its normals are known. Outside it the gel forms a shoulder
that was not measured: its pixels are not valid, and their normals are NaN. The background is the one sample
of flat skin; it is stored last, in split train.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np

from fastac.sensor import dataset
from fastac.sensor.geometry import ball_slopes, normals_from_slopes
from fastac.sensor.importers.footage import CHANNELS, ImportFailure, file_in, photograph
from fastac.sensor.importers.force_labels import split_held_out
from fastac.sensor.importers.resample import Resampling
from fastac.store.progress import progress_bar

BACKGROUND = "background"
"""Group of the background, where presses have groups."""
TEST_EVERY = 5
"""Where a recording names no split, every so-many-th press is in the test split."""
SKIP = "--skip-bad-circles leaves such presses out"
CUT = "--cut-circles takes what is in the image"


@dataclass(frozen=True)
class Press:
    """A photograph of a press and its circle, in pixels of the photograph; integer positions are centres.

    read : returns the photograph, (height, width, 3) uint8 in the order B, G, R
    name, place : what errors name as the origin of the photograph and of its circle
    group : the press's name where it can be held out, else None in all presses
    """

    read: Callable[[], np.ndarray]
    name: str
    place: str
    center_x_px: float
    center_y_px: float
    radius_px: float
    ball_mm: float
    split: str
    group: str | None = None

    @classmethod
    def of_file(cls, path: Path, *others) -> Self:
        """The press of a photograph's file; `others` are the fields from `place` on."""
        return cls(partial(photograph, path), str(path), *others)


def photograph_in(folder: Path, name: str, place: str) -> Path:
    """The path of a press's photograph. Raises ImportFailure with `place` in it if it is not in `folder`."""
    try:
        path = file_in(folder, name)
    except ImportFailure:
        raise ImportFailure(f"{place}: image = {name!r}: not inside {folder}") from None
    if not path.is_file():
        raise ImportFailure(f"{place}: image = {name!r}: not in {folder}")
    return path


def every_fifth(count: int) -> list[str]:
    """The split of presses that have none: every fifth is of the test split, from the fifth on."""
    if count < TEST_EVERY:
        return ["train"] * count
    return ["test" if k % TEST_EVERY == TEST_EVERY - 1 else "train" for k in range(count)]


def splits_of(origin: Path, names: list[str], held_out: tuple[str, ...]) -> list[str]:
    """The split of presses with these names: those of `held_out` are the test split or, if there are none,
    `every_fifth`. Raises ImportFailure as `split_held_out`."""
    if not held_out:
        return every_fifth(len(names))
    return split_held_out(origin, np.array(names), held_out).tolist()


def _checked(
    press: Press, height: int, width: int, px_per_mm: float, reduction_px: float, cut: bool
) -> Press:
    """A press whose circle has a radius `reduction_px` less than it was drawn.

    Raises ImportFailure for a circle larger than the ball, or beyond the image; with `cut` only its centre
    must be in the image.
    """
    place, radius = press.place, press.radius_px - reduction_px
    key = f"radius_px = {press.radius_px:g}" + (f" - {reduction_px:g}" if reduction_px else "")
    if not radius > 0:
        raise ImportFailure(f"{place}: {key}: expected more than 0")
    if radius / px_per_mm >= press.ball_mm / 2:
        raise ImportFailure(
            f"{place}: {key}: {radius / px_per_mm:.3f} mm at {px_per_mm:g} px/mm, expected less than"
            f" the ball's radius of {press.ball_mm / 2:g} mm; --radius-reduction-px makes circles smaller,"
            f" {SKIP}"
        )
    for key, size in (("center_x_px", width), ("center_y_px", height)):
        value = getattr(press, key)
        if not -0.5 <= value <= size - 0.5:
            raise ImportFailure(f"{place}: {key} = {value:g}: not in the image of {size} px; {SKIP}")
        if not cut and not radius - 0.5 <= value <= size - 0.5 - radius:
            raise ImportFailure(
                f"{place}: {key} = {value:g}: a circle of radius {radius:g} px leaves the image of {size} px;"
                f" {CUT}, {SKIP}"
            )
    return replace(press, radius_px=radius)


def _inside(center_px, radius_px, pitch_mm: float, ball_mm: float, shape: tuple[int, int]):
    """Where the skin lies against the ball, bool (H, W), and its normals there (n, 3)."""
    v, u = np.indices(shape)
    x, y = (u - center_px[0]) * pitch_mm, (v - center_px[1]) * pitch_mm
    inside = np.hypot(x, y) <= radius_px * pitch_mm
    return inside, normals_from_slopes(*ball_slopes(x[inside], y[inside], ball_mm))


def write_presses(
    presses: Sequence[Press],
    untouched: np.ndarray,
    *,
    px_per_mm: float,
    source: str,
    output: Path | str,
    height_px: int = 128,
    width_px: int = 128,
    radius_reduction_px: float = 0.0,
    skip_bad_circles: bool = False,
    cut_circles: bool = False,
    left_out: int = 0,
    progress: bool = True,
) -> None:
    """Write the presses and the photograph of the untouched gel, `untouched`, as the dataset `output`.

    Photographs are padded to the target's aspect by the background and resampled by exact area averaging,
    so the pitch is (original px per resampled px) / px_per_mm. `indenter` holds, per sample: center_px
    (u, v) and radius_px in resampled pixels, ball_mm, and scale, the original pixels per resampled one;
    center, radius and ball are NaN for the flat sample.

    radius_reduction_px : what is taken off each circle's radius, in pixels of the photograph: circles are
        drawn by hand, and many are larger than the contact
    skip_bad_circles : leave presses out whose circle is larger than the ball or leaves the image, and count
        them, rather than refuse all
    cut_circles : take of a circle that leaves the image what is in it, where its centre is
    left_out : presses that were dropped before

    Raises ImportFailure on photographs that are missing, unreadable or of another size than the background,
    and on circles that cannot be.
    """
    if not (np.isfinite(radius_reduction_px) and radius_reduction_px >= 0):
        raise ImportFailure(f"{source}: radius_reduction_px = {radius_reduction_px:g}: expected 0 or more")
    resampling = Resampling(*untouched.shape[:2], height_px, width_px)
    pitch_mm = resampling.scale / px_per_mm
    shape = (height_px, width_px)
    named, presses = presses, []
    for press in named:
        try:
            size = untouched.shape[:2]
            presses.append(_checked(press, *size, px_per_mm, radius_reduction_px, cut_circles))
        except ImportFailure:
            if not skip_bad_circles:
                raise
    if not presses:
        raise ImportFailure(
            f"{source}: no circle of {len(named)} presses is smaller than the ball and in the image"
        )
    n = len(presses) + 1

    frames = np.empty((n, *shape, len(CHANNELS)), np.uint8)
    normals = np.full((n, *shape, 3), np.nan, np.float32)
    valid = np.zeros((n, *shape), bool)
    center_px = np.full((n, 2), np.nan)
    radius_px = np.full(n, np.nan)
    in_photograph = resampling.valid()
    for i, press in enumerate(progress_bar(presses, desc="presses", unit="press", enabled=progress)):
        image = press.read()
        if image.shape != untouched.shape:
            raise ImportFailure(
                f"{press.name}: size = {image.shape[1]} x {image.shape[0]} px:"
                f" expected the background's {untouched.shape[1]} x {untouched.shape[0]}"
            )
        frames[i] = np.rint(resampling.frame(image, untouched))
        center_px[i] = resampling.points_px(np.array([press.center_x_px, press.center_y_px]))
        radius_px[i] = press.radius_px / resampling.scale
        inside, inside_normals = _inside(center_px[i], radius_px[i], pitch_mm, press.ball_mm, shape)
        valid[i] = inside & in_photograph
        normals[i][inside] = inside_normals
        normals[i][~valid[i]] = np.nan

    frames[-1] = np.rint(resampling.background(untouched))
    normals[-1][in_photograph] = (0, 0, 1)
    valid[-1] = in_photograph
    grouped = all(press.group is not None for press in presses)

    dataset.write(
        output,
        pitch_mm=pitch_mm,
        channels=CHANNELS,
        source=source,
        background=frames[-1],
        frames=frames,
        split=np.array([*(press.split for press in presses), "train"]),
        normals=normals,
        valid=valid,
        group=np.array([*(press.group for press in presses), BACKGROUND]) if grouped else None,
        left_out=left_out + len(named) - len(presses),
        photograph_px=untouched.shape[:2],
        indenter={
            "center_px": center_px,
            "radius_px": radius_px,
            "ball_mm": np.array([*(press.ball_mm for press in presses), np.nan]),
            "scale": np.full(n, resampling.scale),
        },
    )
