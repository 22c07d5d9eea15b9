"""Importer of recordings with a force gauge: a video or photographs, and a CSV file with a force per
frame."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fastac.sensor.importers import force_labels
from fastac.sensor.importers.footage import ImportFailure, Photographs, Video, check_scale, footage
from fastac.sensor.importers.force_frames import ForceFrame, write_forces
from fastac.sensor.importers.force_labels import Labels, split_held_out
from fastac.store.progress import progress_bar

MAX_BACKGROUND_FORCE_SHARE = 0.1
"""Largest force in a background frame, as a share of the recording's largest force."""


def _check_frames(labels: Labels, first: int) -> None:
    """Raise ImportFailure unless every frame from `first` to the last labelled one has a row."""
    known = np.concatenate([[first - 1], labels.frame[labels.frame >= first]])
    gaps = np.flatnonzero(np.diff(known) > 1)
    if len(gaps):
        missing = known[gaps[0]] + 1
        raise ImportFailure(f"{labels.path}: frame {missing}: no row, though frame {known[-1]} has one")


def _frames(
    source: Photographs | Video, labels: Labels, stop: int, progress: bool = False
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield index and image of the frames before `stop`, which must exist and have the same size.

    Where `stop` is behind the last labelled frame, the recording must end there too.
    """
    shape, last, index = None, int(labels.frame[-1]), -1
    with progress_bar(source, total=stop, desc="background", unit="frame", enabled=progress) as bar:
        for index, image in enumerate(bar):
            if index == stop <= last:
                return
            if index > last:
                raise ImportFailure(f"{labels.path}: frame {index}: no row, but {source.path} has this frame")
            shape = shape or image.shape
            if image.shape != shape:
                raise ImportFailure(
                    f"{source.path}: frame {index} = {image.shape[1]} x {image.shape[0]} px:"
                    f" expected the first frame's {shape[1]} x {shape[0]}"
                )
            yield index, image
    if index + 1 < stop:
        raise ImportFailure(f"{labels.where(-1)}: frame = {last}: {source.path} has {index + 1} frames")


def _background_frames(labels: Labels, count: int, per_group: bool) -> dict[int, int]:
    """The background frames: {frame index: number of the group}, group 0 if all share one background.

    Raises ImportFailure where a group is too short, or the force gauge shows contact in a background frame.
    """
    if per_group:
        chosen = {}
        for number, name in enumerate(labels.groups):
            rows = np.flatnonzero(labels.group == name)
            if len(rows) < count:
                raise ImportFailure(
                    f"{labels.path}: group {name!r} has {len(rows)} frames: expected {count} of background"
                )
            chosen |= dict.fromkeys(labels.frame[rows[:count]].tolist(), number)
    else:
        chosen = dict.fromkeys(range(count), 0)
    size = np.linalg.norm(labels.force_n, axis=1)
    for row in np.flatnonzero(np.isin(labels.frame, list(chosen))):
        if size[row] > MAX_BACKGROUND_FORCE_SHARE * size.max():
            raise ImportFailure(
                f"{labels.where(row)}: {size[row]:g} N in background frame {labels.frame[row]}:"
                f" expected at most {MAX_BACKGROUND_FORCE_SHARE:.0%} of the largest force, {size.max():g} N"
            )
    return chosen


def _backgrounds(source, labels: Labels, chosen: dict[int, int], progress: bool) -> np.ndarray:
    """The mean of each group's background frames, float64 (groups, height, width, C)."""
    sums, counts = None, np.bincount(list(chosen.values()))
    for index, image in _frames(source, labels, max(chosen) + 1, progress):
        if sums is None:
            sums = np.zeros((len(counts), *image.shape), np.uint32)
        if index in chosen:
            sums[chosen[index]] += image
    return sums / counts[:, None, None, None]


def _split(labels: Labels, held_out: tuple[str, ...]) -> np.ndarray:
    """The file's own split, or a split by groups; without `held_out` the last group is the test split."""
    if labels.split is None:
        advice = "name several groups or give a column split"
        return split_held_out(labels.path, labels.group, held_out, advice)
    for name in held_out:
        if name not in labels.groups:
            raise ImportFailure(f"{labels.path}: group {name!r}: expected one of {', '.join(labels.groups)}")
    if held_out:
        raise ImportFailure(f"{labels.path}: split: a column of its own, so no group can be held out too")
    return labels.split


def import_recording(
    source: Path | str,
    forces: Path | str,
    *,
    background_frames: int,
    pitch_mm: float,
    output: Path | str,
    per_group: bool = False,
    held_out: tuple[str, ...] = (),
    height_px: int = 128,
    width_px: int = 128,
    progress: bool = True,
) -> None:
    """Import the frames of `source`, a video or a folder, with the forces of a CSV file (see force_labels).

    background_frames : number of leading no-contact frames averaged into the background; those without a row
        in the CSV file are not imported as samples
    per_group : average the leading no-contact frames of each group into a background of its own. The group's
        frames are then shifted by the difference of this background from the mean of all groups' backgrounds,
        so that one background serves all: the pipeline uses differences from it only.
    pitch_mm : size of a resampled pixel; held_out : groups of the test split (default: the last)

    Frames are padded to the target's aspect by the background and resampled by exact area averaging. A video
    is decoded twice rather than kept. Raises ImportFailure on anything missing, unreadable or inconsistent.
    """
    source, forces = footage(Path(source)), Path(forces)
    check_scale(source.path, "pitch_mm", pitch_mm)
    labels = force_labels.read(forces, source)
    last = int(labels.frame[-1])
    if not 1 <= background_frames <= last + 1:
        raise ImportFailure(f"{forces}: background_frames = {background_frames}: expected 1 to {last + 1}")
    split = _split(labels, held_out)
    _check_frames(labels, 0 if per_group else background_frames)
    chosen = _background_frames(labels, background_frames, per_group)

    means = _backgrounds(source, labels, chosen, progress)
    names = labels.groups if per_group else [""]
    rows = {int(frame): row for row, frame in enumerate(labels.frame)}

    def samples() -> Iterator[ForceFrame]:
        for index, image in _frames(source, labels, last + 1):
            row = rows.get(index)
            if row is not None:
                group = str(labels.group[row])
                recording, place = group if per_group else "", f"{source.path}: frame {index}"
                yield ForceFrame(image, tuple(labels.force_n[row]), recording, group, place, split[row])

    write_forces(
        samples(),
        len(rows),
        dict(zip(names, means, strict=True)),
        origin=forces,
        pitch_mm=pitch_mm,
        source=f"recorded: forces from {source.path.name}",
        output=output,
        axes=labels.axes,
        height_px=height_px,
        width_px=width_px,
        progress=progress,
    )
