"""Imports frames with forces in the layout of FEATS as a dataset.

The layout is that of FEATS (GitHub, feats-ai/feats, src/feats/scripts/label_generation.py,
src/feats/src/data/dataloader.py and src/linuxcnc/src/cnc_data_aquisition.py): one .npy a frame, a dict that
np.save has pickled, with

    gs_img           (240, 320, 3) uint8, R, G, B
    f_x, f_y, f_z    N; z is negative in compression, as the force on the gel is
    indenter         in raw recordings: the indenter's name

and, unused here, grid_x, grid_y, grid_z (forces of cells) or the machine's pose. Files lie in a folder, or in
its folders train, val and test, which then are the splits.

Of the forces z alone is negated. A dataset has the force of the skin on what it touches, and x and y of the
labels are that along the image's columns and rows already: the finite elements have the force on the gel, in
axes that point against the image's (src/feats/homography/homography.npy). In raw recordings the axes are the
gauge's own.

A frame's group is its indenter or, where the file has none, what the pattern finds in the file's name.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fastac.sensor.importers import plain_pickle
from fastac.sensor.importers.footage import ImportFailure, by_number, file_in, photograph
from fastac.sensor.importers.force_frames import ForceFrame, Written, checked_image, write_forces

SPLITS = {"train": "train", "val": "validation", "test": "test"}
"""Folders and the splits that they are."""
GROUP = r"[A-Za-z]\w*"
"""The pattern of a group in a file's name: sphere_10 in 100_1744012609911964307_sphere_10.npy."""
FORCES = ("f_x", "f_y", "f_z")


def _files(folder: Path) -> list[tuple[Path, str | None]]:
    """The frames' files in the order of their numbers, with their splits. Raises ImportFailure for none."""

    def inside(place: str) -> list[Path]:
        names = [path.name for path in (folder / place).iterdir() if path.suffix == ".npy"]
        return sorted((file_in(folder, f"{place}/{name}") for name in names), key=by_number)

    if not folder.is_dir():
        raise ImportFailure(f"{folder}: no such folder")
    parts = [name for name in SPLITS if (folder / name).is_dir()]
    found = [(path, SPLITS[name]) for name in parts for path in inside(name)]
    found = found or [(path, None) for path in inside(".")]
    if not found:
        raise ImportFailure(f"{folder}: no frames: expected .npy files there or in its train, val and test")
    return found


def _sample(path: Path) -> dict:
    sample = plain_pickle.load_npy(path)
    if not isinstance(sample, dict):
        raise ImportFailure(f"{path}: an array: expected a dict with gs_img")
    if "gs_img" not in sample:
        raise ImportFailure(f"{path}: gs_img: missing key")
    return sample


def _force_n(path: Path, sample: dict) -> tuple[float, float, float]:
    """The force of the skin on what it touches, N."""
    for key in FORCES:
        value = sample.get(key)
        if isinstance(value, np.ndarray) and value.shape == () and value.dtype.kind in "iuf":
            sample[key] = value = value.item()
        if key not in sample:
            raise ImportFailure(f"{path}: {key}: missing key")
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise ImportFailure(f"{path}: {key} = {type(value).__name__}: expected a number")
    x, y, z = (float(sample[key]) for key in FORCES)
    return x, y, -z


def _group(path: Path, sample: dict, pattern: re.Pattern) -> str:
    if isinstance(sample.get("indenter"), str) and sample["indenter"]:
        return sample["indenter"]
    found = pattern.search(path.stem)
    if not found or not found[0]:
        raise ImportFailure(f"{path}: the pattern {pattern.pattern!r} finds no group in this name")
    return found[0]


def _frames(files: list[tuple[Path, str | None]], pattern: re.Pattern) -> Iterator[ForceFrame]:
    for path, split in files:
        sample = _sample(path)
        image = checked_image(sample["gs_img"], f"{path}: gs_img")
        force_n, group = _force_n(path, sample), _group(path, sample, pattern)
        yield ForceFrame(image, force_n, "", group, f"{path}: gs_img", split)


def import_folder(
    folder: Path | str,
    background: Path | str,
    *,
    pitch_mm: float,
    output: Path | str,
    held_out: tuple[str, ...] = (),
    group_pattern: str = GROUP,
    every: int = 1,
    height_px: int = 128,
    width_px: int = 128,
    keep_pulls: bool = False,
    progress: bool = True,
) -> Written:
    """Import the frames of a folder in the layout of FEATS (see above) into the dataset `output`.

    background : the untouched gel: an .npy with gs_img, such as FEATS' nocontact_train_sensor.npy, or a
        photograph
    held_out : groups of the test split; without it the folders' splits, or the last group in a single folder
    group_pattern : regular expression; a group is what it finds first in a file's name
    every : take each so-many-th file
    keep_pulls, returns : as in `force_frames.write_forces`

    Raises ImportFailure on anything missing, unreadable or inconsistent.
    """
    folder, background = Path(folder), Path(background)
    try:
        pattern = re.compile(group_pattern)
    except re.error as error:
        raise ImportFailure(f"{folder}: group pattern {group_pattern!r}: {error}") from None
    if background.suffix == ".npy":
        untouched = checked_image(_sample(background)["gs_img"], f"{background}: gs_img")
    else:
        untouched = photograph(background)
    files = _files(folder)[::every]
    return write_forces(
        _frames(files, pattern),
        len(files),
        {"": untouched},
        origin=folder,
        pitch_mm=pitch_mm,
        source=f"recorded: FEATS frames from {folder.resolve().name}",
        output=output,
        held_out=held_out,
        height_px=height_px,
        width_px=width_px,
        keep_pulls=keep_pulls,
        progress=progress,
    )
