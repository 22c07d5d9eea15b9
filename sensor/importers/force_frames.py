"""Writes frames with forces, from recordings that each have a background of their own, as one dataset.

Importers of other layouts give their frames one at a time. Each is resampled and shifted by the difference
of its recording's background from the mean of all recordings' backgrounds, so that one background serves all:
the pipeline uses differences from it only.
"""

import math
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fastac.sensor import dataset
from fastac.sensor.importers.delays import Delay, delays
from fastac.sensor.importers.footage import CHANNELS, ImportFailure, check_scale
from fastac.sensor.importers.force_labels import check_compression, largest_pull_n, split_held_out
from fastac.sensor.importers.resample import Resampling
from fastac.sensor.samples import FORCE_AXES
from fastac.store.progress import progress_bar

MOST_IN_MEMORY = 1 << 30
"""Bytes of frames; more are kept in a file without a name, beside the dataset, until they are written."""


@dataclass(frozen=True)
class ForceFrame:
    """A frame (height, width, 3) uint8 in the order B, G, R, and its force, N, z positive in compression.

    recording : whose background it has; group : what is held out as a whole; place : what errors call it
    split : train, validation or test, where the layout says so in all frames
    """

    image: np.ndarray
    force_n: tuple[float, ...]
    recording: str
    group: str
    place: str
    split: str | None = None


class Written(NamedTuple):
    """What became of the frames: how many were left out because F_z is below -limit_n, and in which
    recordings frames and forces are apart in time."""

    pulled: int
    limit_n: float
    delays: tuple[Delay, ...]


def size_of(image: np.ndarray) -> str:
    return f"{image.shape[1]} x {image.shape[0]} px"


def checked_image(image: object, place: str) -> np.ndarray:
    """An RGB image of a layout in the order B, G, R. Raises ImportFailure unless it is (H, W, 3) uint8."""
    if not isinstance(image, np.ndarray):
        raise ImportFailure(f"{place} = {type(image).__name__}: expected an image, (height, width, 3) uint8")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        found = f"{image.dtype} of shape {image.shape}"
        raise ImportFailure(f"{place} = {found}: expected an image, (height, width, 3) uint8")
    return image[..., ::-1]


def mean_image(images: Iterable[tuple[np.ndarray, str]]) -> np.ndarray:
    """The mean of images with their places, float64. Raises ImportFailure where their sizes differ."""
    total, count = None, 0
    for image, place in images:
        total = np.zeros(image.shape) if total is None else total
        if image.shape != total.shape:
            raise ImportFailure(f"{place} = {size_of(image)}: expected the first frame's {size_of(total)}")
        total += image
        count += 1
    return total / count


def _room(shape: tuple[int, ...], folder: Path) -> np.ndarray:
    """Room for frames: memory, or, where they are many, a file that is gone when it is closed."""
    if math.prod(shape) <= MOST_IN_MEMORY:
        return np.empty(shape, np.uint8)
    with tempfile.TemporaryFile(dir=folder) as file:
        return np.memmap(file, np.uint8, "w+", shape=shape)  # which keeps the file open


def write_forces(
    frames: Iterable[ForceFrame],
    count: int,
    backgrounds: Mapping[str, np.ndarray],
    *,
    origin: Path | str,
    pitch_mm: float,
    source: str,
    output: Path | str,
    axes: tuple[str, ...] = FORCE_AXES,
    held_out: tuple[str, ...] = (),
    height_px: int = 128,
    width_px: int = 128,
    left_out: int = 0,
    keep_pulls: bool = False,
    progress: bool = True,
) -> Written:
    """Write `count` frames as the dataset `output`, without those in which F_z is negative by more than a
    gauge's zero drifts (`force_labels.largest_pull_n`); returns how many these were, and which recordings'
    frames and forces are apart in time (`delays`).

    backgrounds : {recording: its untouched skin, (height, width, 3) in the order B, G, R}
    origin : the folder or file that errors about all frames name
    axes : of the forces, z last
    held_out : groups of the test split, whatever split the layout has; without it that split holds or, where
        there is none, the last group is the test split
    left_out : frames that were dropped before
    keep_pulls : keep frames whatever their F_z

    Raises ImportFailure for frames and backgrounds of several sizes, forces that are not finite or negative
    in compression, and groups that cannot be held out.
    """
    check_scale(origin, "pitch_mm", pitch_mm)
    if not count:
        raise ImportFailure(f"{origin}: no frame with a force")
    first, *others = backgrounds
    shape = backgrounds[first].shape
    for name in others:
        if backgrounds[name].shape != shape:
            sizes = f"{size_of(backgrounds[name])}: expected {size_of(backgrounds[first])} as of {first!r}"
            raise ImportFailure(f"{origin}: background of {name!r} = {sizes}")
    resampling = Resampling(*shape[:2], height_px, width_px)
    background = resampling.background(np.mean(list(backgrounds.values()), axis=0))
    shifts = {name: background - resampling.covered(own) for name, own in backgrounds.items()}

    room = _room((count, height_px, width_px, len(CHANNELS)), Path(output).absolute().parent)
    force_n, change = np.zeros((count, len(axes)), np.float32), np.zeros(count)
    recording, group, split = [], [], []
    with progress_bar(frames, total=count, desc="frames", unit="frame", enabled=progress) as bar:
        for k, frame in enumerate(bar):
            if frame.image.shape != shape:
                sizes = f"{size_of(frame.image)}: expected the background's {size_of(backgrounds[first])}"
                raise ImportFailure(f"{frame.place} = {sizes}")
            if not np.isfinite(frame.force_n).all():
                raise ImportFailure(f"{frame.place}: force {frame.force_n} N: expected numbers")
            room[k] = np.clip(np.rint(resampling.covered(frame.image) + shifts[frame.recording]), 0, 255)
            force_n[k] = frame.force_n
            change[k] = np.abs(room[k] - background).mean()
            recording.append(frame.recording)
            group.append(frame.group)
            split.append(frame.split)
    check_compression(origin, force_n)
    limit_n = np.inf if keep_pulls else largest_pull_n(force_n)
    kept = np.flatnonzero(force_n[:, -1] >= -limit_n)
    for k, index in enumerate(kept):
        if k != index:  # in place, for the frames may be more than fits in memory
            room[k] = room[index]
    groups = np.array(group)[kept]
    known = all(name is not None for name in split) and not held_out
    dataset.write(
        output,
        pitch_mm=pitch_mm,
        channels=CHANNELS,
        source=source,
        background=np.rint(background).astype(np.uint8),
        frames=room[: len(kept)],
        split=np.array(split)[kept] if known else split_held_out(origin, groups, held_out),
        force_n=force_n[kept],
        force_axes=axes,
        group=groups,
        left_out=left_out + count - len(kept),
        photograph_px=shape[:2],
    )
    return Written(count - len(kept), limit_n, delays(recording, change, force_n[:, -1]))
