"""Imports grasps of objects in the layout of EstimateModulus (GitHub, GelSight-lab/EstimateModulus) as a
dataset.

A folder such as its example_data/2023-12-16 has for each grasp

    golf_ball__t=0.avi           the video of a GelSight Wedge in a gripper
    golf_ball__t=0_forces.pkl    the grasping force in each of its frames, N, positive in compression, a list

The object, golf_ball, is the group, and can be held out as a whole. Each grasp has a background of its own.
Older folders of the project number grasps as golf_ball_1.avi.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from fastac.sensor.importers import plain_pickle
from fastac.sensor.importers.footage import ImportFailure, Video, by_number, file_in
from fastac.sensor.importers.force_frames import ForceFrame, Written, mean_image, write_forces

NUMBER = re.compile(r"(__t=|_)\d+$")
"""What tells an object's grasps apart, at the end of their names."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """A video and the force in each of its frames, N, (frames,)."""

    path: Path
    force_n: np.ndarray

    @property
    def group(self) -> str:
        return NUMBER.sub("", self.path.stem)

    def frames(self, crop_px: Sequence[int] | None) -> Iterator[np.ndarray]:
        """Its frames, (height, width, 3) uint8 in the order B, G, R, or of each what `crop_px` says.

        Raises ImportFailure where there are more or fewer of them than forces.
        """
        count = -1
        for count, image in enumerate(Video(self.path)):
            if count == len(self.force_n):
                raise ImportFailure(f"{self.path}: frame {count}: no force, there are {len(self.force_n)}")
            yield image if crop_px is None else cropped(image, crop_px, self.path)
        if count + 1 < len(self.force_n):
            raise ImportFailure(
                f"{self.path}: {count + 1} frames: expected one for {len(self.force_n)} forces"
            )


def cropped(image: np.ndarray, crop_px: Sequence[int], place: Path) -> np.ndarray:
    """The part of an image (H, W, C) from column left and row top on, crop_px = (left, top, width, height).

    Raises ImportFailure for a part that is not inside the image.
    """
    left, top, width, height = crop_px
    inside = min(left, top) >= 0 and min(width, height) > 0
    if not inside or left + width > image.shape[1] or top + height > image.shape[0]:
        size = f"{image.shape[1]} x {image.shape[0]} px"
        raise ImportFailure(
            f"{place}: crop_px = {left}, {top}, {width}, {height}: not inside the frame's {size}"
        )
    return image[top : top + height, left : left + width]


def _forces_n(path: Path) -> np.ndarray:
    found = plain_pickle.load(path)
    values = np.asarray(found) if isinstance(found, list | tuple | np.ndarray) else np.array("")
    if values.ndim != 1 or values.dtype.kind not in "iuf" or not len(values):
        raise ImportFailure(f"{path}: expected a list of forces, N")
    return values.astype(float)


def _grasps(folder: Path) -> list[Grasp]:
    if not folder.is_dir():
        raise ImportFailure(f"{folder}: no such folder")
    videos = sorted((path for path in folder.iterdir() if path.suffix == ".avi"), key=by_number)
    if not videos:
        raise ImportFailure(f"{folder}: no grasps: expected videos such as golf_ball__t=0.avi")
    return [
        Grasp(file_in(folder, path.name), _forces_n(file_in(folder, f"{path.stem}_forces.pkl")))
        for path in videos
    ]


def import_folder(
    folder: Path | str,
    *,
    background_frames: int,
    pitch_mm: float,
    output: Path | str,
    crop_px: Sequence[int] | None = None,
    delay_frames: int = 0,
    negate: bool = False,
    held_out: tuple[str, ...] = (),
    height_px: int = 128,
    width_px: int = 128,
    keep_pulls: bool = False,
    progress: bool = True,
) -> Written:
    """Import the grasps of a folder (see above) into the dataset `output`.

    background_frames : the mean of so many first frames of each grasp, without contact, is its background
    crop_px : left, top, width and height of the part of each frame that shows the gel; None: all of it
    delay_frames : of the videos: frame k + delay_frames has the force k; frames and forces without one
        another are left out, and not counted
    negate : for gauges whose forces are negative in compression, as those of the project's oldest folders
    held_out : objects of the test split (default: the last)
    keep_pulls, returns : as in `force_frames.write_forces`

    Raises ImportFailure on anything missing, unreadable or inconsistent.
    """
    folder = Path(folder)
    grasps = _grasps(folder)
    backgrounds, sign = {}, -1 if negate else 1
    for grasp in grasps:
        if abs(delay_frames) >= len(grasp.force_n):
            few = f"expected less than its {len(grasp.force_n)} frames"
            raise ImportFailure(f"{grasp.path}: delay_frames = {delay_frames}: {few}")
        if not 1 <= background_frames <= len(grasp.force_n):
            raise ImportFailure(
                f"{grasp.path}: background_frames = {background_frames}: expected 1 to {len(grasp.force_n)}"
            )
        first = islice(grasp.frames(crop_px), background_frames)
        backgrounds[grasp.path.stem] = mean_image((image, str(grasp.path)) for image in first)

    def frames() -> Iterator[ForceFrame]:
        for grasp in grasps:
            for k, image in enumerate(grasp.frames(crop_px)):
                if 0 <= k - delay_frames < len(grasp.force_n):
                    force_n = sign * float(grasp.force_n[k - delay_frames])
                    place = f"{grasp.path}: frame {k}"
                    yield ForceFrame(image, (force_n,), grasp.path.stem, grasp.group, place)

    return write_forces(
        frames(),
        sum(len(grasp.force_n) - abs(delay_frames) for grasp in grasps),
        backgrounds,
        origin=folder,
        pitch_mm=pitch_mm,
        source=f"recorded: EstimateModulus {folder.resolve().name}",
        output=output,
        axes=("z",),
        held_out=held_out,
        height_px=height_px,
        width_px=width_px,
        keep_pulls=keep_pulls,
        progress=progress,
    )
