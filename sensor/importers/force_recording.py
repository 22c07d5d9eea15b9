"""Importer of recordings with a force gauge: videos or folders of photographs, each with a CSV file that has
a force per frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from fastac.sensor.importers import force_labels
from fastac.sensor.importers.footage import ImportFailure, Photographs, Video, check_scale, footage
from fastac.sensor.importers.force_frames import ForceFrame, Written, write_forces
from fastac.sensor.importers.force_labels import Labels, known_groups, split_held_out
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


@dataclass(frozen=True, eq=False)
class _Recording:
    """A recording, checked as far as it can be without reading its frames."""

    source: Photographs | Video
    labels: Labels
    chosen: dict[int, int]
    """As `_background_frames` gives them."""
    per_group: bool

    @classmethod
    def of(
        cls, source: Path, forces: Path, background_frames: int, per_group: bool, negate: bool
    ) -> "_Recording":
        frames = footage(source)
        labels = force_labels.read(forces, frames, negate=negate)
        count = int(labels.frame[-1]) + 1
        if not 1 <= background_frames <= count:
            raise ImportFailure(f"{forces}: background_frames = {background_frames}: expected 1 to {count}")
        _check_frames(labels, 0 if per_group else background_frames)
        return cls(frames, labels, _background_frames(labels, background_frames, per_group), per_group)

    def name(self, group: str) -> str:
        """Of the background that frames of a group have."""
        return f"{self.labels.path}: {group}" if self.per_group else str(self.labels.path)

    def backgrounds(self, progress: bool) -> dict[str, np.ndarray]:
        """The mean of each group's background frames, (height, width, C) float64, or of the recording's."""
        sums, counts = None, np.bincount(list(self.chosen.values()))
        for index, image in _frames(self.source, self.labels, max(self.chosen) + 1, progress):
            if sums is None:
                sums = np.zeros((len(counts), *image.shape), np.uint32)
            if index in self.chosen:
                sums[self.chosen[index]] += image
        names = [self.name(group) for group in (self.labels.groups if self.per_group else [""])]
        return dict(zip(names, sums / counts[:, None, None, None], strict=True))

    def samples(self, split: np.ndarray) -> Iterator[ForceFrame]:
        """The labelled frames, with the split of each row."""
        rows = {int(frame): row for row, frame in enumerate(self.labels.frame)}
        for index, image in _frames(self.source, self.labels, int(self.labels.frame[-1]) + 1):
            row = rows.get(index)
            if row is not None:
                group, place = str(self.labels.group[row]), f"{self.source.path}: frame {index}"
                force_n = tuple(self.labels.force_n[row])
                yield ForceFrame(image, force_n, self.name(group), group, place, split[row])


def _check_alike(every: list[Labels]) -> None:
    """Raise ImportFailure unless all files have the same columns, and each is named once."""
    paths = [str(labels.path) for labels in every]
    for path in paths:
        if paths.count(path) > 1:
            raise ImportFailure(f"{path}: named twice: expected a file of forces for each recording")
    first, *others = every
    for labels in others:
        if (labels.split is None) != (first.split is None):
            has, lacks = (first, labels) if labels.split is None else (labels, first)
            raise ImportFailure(f"{lacks.path}: split: missing column, which {has.path} has")
        if labels.axes != first.axes:
            axes = " and ".join(force_labels.COLUMNS[axis] for axis in first.axes)
            raise ImportFailure(f"{labels.path}: forces: expected {axes}, as {first.path} has")


def _splits(origin: str, every: list[Labels], held_out: tuple[str, ...]) -> list[np.ndarray]:
    """The split of each file's rows: the files' own, or by groups; without `held_out` the last group is the
    test split."""
    group = np.concatenate([labels.group for labels in every])
    if every[0].split is None:
        advice = "name several groups or give a column split"
        split = split_held_out(origin, group, held_out, advice)
        return np.split(split, np.cumsum([len(labels.frame) for labels in every])[:-1])
    known_groups(origin, group, held_out)
    if held_out:
        raise ImportFailure(f"{origin}: split: a column of its own, so no group can be held out too")
    return [labels.split for labels in every]


def import_recordings(
    recordings: Sequence[tuple[Path | str, Path | str]],
    *,
    background_frames: int,
    pitch_mm: float,
    output: Path | str,
    per_group: bool = False,
    held_out: tuple[str, ...] = (),
    negate: bool = False,
    height_px: int = 128,
    width_px: int = 128,
    keep_pulls: bool = False,
    progress: bool = True,
) -> Written:
    """Import recordings, each a video or a folder and the CSV file of its forces (see force_labels), into the
    dataset `output`. A group may have frames in several of them.

    background_frames : number of a recording's leading no-contact frames averaged into its background; those
        without a row in the CSV file are not imported as samples
    per_group : average the leading no-contact frames of each group of a recording into a background of its
        own
    pitch_mm : size of a resampled pixel; held_out : groups of the test split (default: the last)
    negate : for gauges whose z is negative in compression
    keep_pulls, returns : as in `force_frames.write_forces`

    Frames are shifted by the difference of their background from the mean of all backgrounds, so that one
    serves all: the pipeline uses differences from it only. They are padded to the target's aspect by the
    background and resampled by exact area averaging. A video is decoded twice rather than kept. Raises
    ImportFailure on anything missing, unreadable or inconsistent.
    """
    check_scale(recordings[0][0], "pitch_mm", pitch_mm)
    known = [
        _Recording.of(Path(source), Path(forces), background_frames, per_group, negate)
        for source, forces in recordings
    ]
    every = [recording.labels for recording in known]
    _check_alike(every)
    origin = ", ".join(str(labels.path) for labels in every)
    splits = _splits(origin, every, held_out)
    backgrounds = {}
    for recording in known:
        backgrounds |= recording.backgrounds(progress)
    return write_forces(
        chain.from_iterable(recording.samples(split) for recording, split in zip(known, splits, strict=True)),
        sum(len(labels.frame) for labels in every),
        backgrounds,
        origin=origin,
        pitch_mm=pitch_mm,
        source=f"recorded: forces from {', '.join(recording.source.path.name for recording in known)}",
        output=output,
        axes=every[0].axes,
        height_px=height_px,
        width_px=width_px,
        keep_pulls=keep_pulls,
        progress=progress,
    )
