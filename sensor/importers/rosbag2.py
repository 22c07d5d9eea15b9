"""Imports ROS 2 recordings, rosbag2 or MCAP, of a camera and a force gauge as a dataset.

Of each recording (a rosbag2 folder, or a file .mcap or .db3) two topics are read: images, as
sensor_msgs/msg/Image (rgb8, bgr8, rgba8, bgra8) or CompressedImage (PNG, JPEG), and forces in N, as
geometry_msgs/msg/WrenchStamped. A frame has the force of the wrench nearest in time; frames without one
within the tolerance are left out and counted. The first images of a recording, without contact, are its
background. Where x and y are NaN throughout, z alone is known.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.force_frames import ForceFrame, Written, mean_image, write_forces
from fastac.sensor.importers.force_recording import MAX_BACKGROUND_FORCE_SHARE
from fastac.sensor.importers.ros_recording import Clock, RosRecording, require_packages
from fastac.sensor.samples import FORCE_AXES
from fastac.store.progress import progress_bar

CONTACT_SHARE = MAX_BACKGROUND_FORCE_SHARE
"""A press begins where the force rises above this share of the recording's largest one."""


@dataclass(frozen=True)
class Matched:
    """A recording with each image's force, (images, 3), NaN where no wrench was near enough in time."""

    recording: RosRecording
    force_n: np.ndarray
    background: np.ndarray

    def rows(self, every: int) -> np.ndarray:
        """Numbers of the images that have a force, each so-many-th of them."""
        return np.flatnonzero(~np.isnan(self.force_n[:, -1]))[::every]

    def press(self) -> np.ndarray:
        """The number of each image's press, from 1, with what follows it; before the first one 1 too."""
        size = np.linalg.norm(np.nan_to_num(self.force_n), axis=1)
        touched = size > CONTACT_SHARE * size.max()
        begins = touched & ~np.concatenate([[False], touched[:-1]])
        return np.cumsum(begins).clip(1)


def _forces(recording: RosRecording, tolerance_ns: int, sign: int, tare: int) -> np.ndarray:
    """Each image's force, less the mean force of the first `tare` images."""
    row = recording.nearest(tolerance_ns)
    force_n = np.where(row[:, None] >= 0, sign * recording.force_n[row], np.nan)
    if np.isnan(force_n[row >= 0, -1]).any():
        raise ImportFailure(f"{recording.path}: wrench.force.z = NaN: expected numbers")
    if not tare:
        return force_n
    if not (row[:tare] >= 0).any():
        raise ImportFailure(f"{recording.path}: no wrench near the first {tare} images: nothing to tare by")
    return force_n - force_n[:tare][row[:tare] >= 0].mean(axis=0)


def _check_background(recording: RosRecording, force_n: np.ndarray, count: int) -> None:
    """Raise ImportFailure where there are too few images, or the gauge shows contact in the first ones."""
    if len(force_n) < count:
        raise ImportFailure(f"{recording.path}: {len(force_n)} images: expected {count} of background")
    size = np.linalg.norm(np.nan_to_num(force_n), axis=1)
    if size[:count].max() > MAX_BACKGROUND_FORCE_SHARE * size.max():
        k = size[:count].argmax()
        raise ImportFailure(
            f"{recording.path}: {size[k]:g} N in background image {k}: expected at most"
            f" {MAX_BACKGROUND_FORCE_SHARE:.0%} of the largest force, {size.max():g} N"
            " (--tare takes a gauge's offset off)"
        )


def _matched(
    recordings: Iterable[RosRecording], count: int, tolerance_ns: int, sign: int, tare: bool
) -> Iterator[Matched]:
    """Each recording with its forces and its background, the mean of the first `count` images."""
    for recording in recordings:
        force_n = _forces(recording, tolerance_ns, sign, count if tare else 0)
        _check_background(recording, force_n, count)
        first = np.arange(len(force_n)) < count
        background = mean_image((image, place) for _, image, place in recording.images(first))
        yield Matched(recording, force_n, background)


def _frames(found: list[Matched], axes: tuple[str, ...], every: int, group_by: str) -> Iterator[ForceFrame]:
    for matched in found:
        name, wanted = matched.recording.name, np.zeros(len(matched.force_n), bool)
        wanted[matched.rows(every)] = True
        press = matched.press()
        for k, image, place in matched.recording.images(wanted):
            force_n = tuple(matched.force_n[k, -len(axes) :].tolist())
            group = name if group_by == "recording" else f"{name}/{press[k]}"
            yield ForceFrame(image, force_n, name, group, place)


def import_recordings(
    paths: Iterable[Path | str],
    *,
    pitch_mm: float,
    background_frames: int,
    output: Path | str,
    image_topic: str | None = None,
    wrench_topic: str | None = None,
    tolerance_ms: float = 20.0,
    clock: Clock = "stamp",
    group_by: str = "recording",
    held_out: tuple[str, ...] = (),
    every: int = 1,
    negate: bool = False,
    tare: bool = False,
    height_px: int = 128,
    width_px: int = 128,
    keep_pulls: bool = False,
    progress: bool = True,
) -> Written:
    """Import ROS 2 recordings (see above) into the dataset `output`.

    image_topic, wrench_topic : needed where a recording has several of these types
    tolerance_ms : how far in time a frame's wrench may be from it, ms
    clock : "stamp", the time in the messages' headers, or "log", the time at which they were recorded
    group_by : "recording" (by its name) or "press" (its name and the press's number: a press begins where the
        force rises above a tenth of the recording's largest one)
    held_out : groups of the test split (default: the last); every : take each so-many-th frame with a force
    negate : for gauges of which z is negative in compression
    tare : take the mean force of a recording's background images off its forces
    keep_pulls, returns : as in `force_frames.write_forces`

    Raises ImportFailure on anything missing, unreadable or inconsistent.
    """
    require_packages()
    files = [Path(path) for path in paths]
    if not 0 <= tolerance_ms < np.inf:
        raise ImportFailure(f"{files[0]}: tolerance_ms = {tolerance_ms:g}: expected 0 or more")
    scanned = []
    for path in progress_bar(files, desc="times", unit="recording", enabled=progress):
        scanned.append(RosRecording.scan(path, image_topic, wrench_topic, clock))
        if any(scanned[-1].name == other.name for other in scanned[:-1]):
            raise ImportFailure(f"{path}: another recording has the name {scanned[-1].name!r} too")
    tolerance_ns, sign = round(tolerance_ms * 1e6), -1 if negate else 1
    found = list(_matched(scanned, background_frames, tolerance_ns, sign, tare))
    known = np.concatenate([matched.force_n[matched.rows(1)] for matched in found])
    if not len(known):
        near = f"within {tolerance_ms:g} ms, by their {clock} times"
        raise ImportFailure(f"{files[0]}: no image has a wrench {near}")
    axes = FORCE_AXES if np.isfinite(known[:, :2]).any() else FORCE_AXES[-1:]
    rows = [matched.rows(every) for matched in found]
    return write_forces(
        _frames(found, axes, every, group_by),
        sum(map(len, rows)),
        {matched.recording.name: matched.background for matched in found},
        origin=files[0],
        pitch_mm=pitch_mm,
        source=f"recorded: ROS 2 recordings {', '.join(matched.recording.name for matched in found)}"[:200],
        output=output,
        axes=axes,
        held_out=held_out,
        height_px=height_px,
        width_px=width_px,
        left_out=sum(len(matched.force_n) - len(matched.rows(1)) for matched in found),
        keep_pulls=keep_pulls,
        progress=progress,
    )
