"""Imports frames with forces in the layout of TacBench's force estimation as a dataset.

The layout is that of Sparsh (GitHub, facebookresearch/sparsh, README.md, tactile_ssl/data/digit/utils.py and
tactile_ssl/data/vision_based_forces_slip_probes.py), for DIGIT and for GelSight Mini:

    sphere/batch_1/dataset_digit_00.pkl, …    lists of images: bytes of PNG or JPEG, or RGB (H, W, 3) uint8
    sphere/batch_1/dataset_slip_forces.pkl    a dict:
        in_contact      a number for each image of the batch; 0: nothing touches
        trajectories    a dict of strokes, each a dict with
            indexes     of the images, from 0
            forces      (n, 3) x, y, z, N; z is positive in compression. The first n images have these; of
                        the last five a stroke may have no force

The pickles are not unpickled (plain_pickle.py). Each batch is a recording; its background is the mean of its
first images without contact. Images outside strokes have no force and are left out.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from fastac.sensor.importers import plain_pickle
from fastac.sensor.importers.footage import ImportFailure, by_number, encoded_photograph, file_in
from fastac.sensor.importers.force_frames import ForceFrame, Written, checked_image, mean_image, write_forces

FORCES = "dataset_slip_forces.pkl"
UNLABELLED = 5
"""The most images at a stroke's end that may lack a force: the benchmark never reads theirs."""


@dataclass(frozen=True)
class Batch:
    """A batch: its files of images and, in their order, each labelled image's index, force and stroke."""

    name: str
    images: tuple[Path, ...]
    in_contact: np.ndarray
    index: np.ndarray
    force_n: np.ndarray
    stroke: np.ndarray

    def group(self, row: int, by: str) -> str:
        probe = self.name.rsplit("/", 1)[0]
        return {"batch": self.name, "probe": probe, "stroke": f"{self.name}/{self.stroke[row]}"}[by]

    def all_images(self) -> Iterator[tuple[int, object, str]]:
        """Every image as it is stored, encoded or not, with its index and its place for errors."""
        index = 0
        for path in self.images:
            held = plain_pickle.load(path)
            if not isinstance(held, list | np.ndarray):
                raise ImportFailure(f"{path}: {type(held).__name__}: expected a list of images")
            for k, image in enumerate(held):
                yield index, image, f"{path}: image {k}"
                index += 1


def _decoded(image: object, place: str) -> np.ndarray:
    if isinstance(image, bytes):
        return encoded_photograph(image, place)
    return checked_image(image, place)


def _numbers(value: object, place: str, shape: tuple, kinds: str) -> np.ndarray:
    """An array of numbers of a file, of the axes in `shape`; None is any length. Raises ImportFailure."""
    try:
        array = np.asarray(value)
    except ValueError:  # lists of several lengths
        array = np.empty(0, object)
    fits = array.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if array.dtype.kind not in kinds or not fits or not np.isfinite(array).all():
        want = "(" + ", ".join("n" if size is None else str(size) for size in shape) + ")"
        raise ImportFailure(
            f"{place} = {array.dtype} of shape {array.shape}: expected numbers of shape {want}"
        )
    return array


def _batch(folder: Path, name: str) -> Batch:
    """The batch in a folder below the recording's. Raises ImportFailure for what its files lack."""
    here = folder / name
    path = file_in(folder, f"{name}/{FORCES}")
    labels = plain_pickle.load(path)
    if not isinstance(labels, dict):
        raise ImportFailure(f"{path}: {type(labels).__name__}: expected a dict")
    for key in ("in_contact", "trajectories"):
        if key not in labels:
            raise ImportFailure(f"{path}: {key}: missing key")
    strokes = labels["trajectories"]
    if not isinstance(strokes, dict):
        raise ImportFailure(f"{path}: trajectories = {type(strokes).__name__}: expected a dict")
    in_contact = _numbers(labels["in_contact"], f"{path}: in_contact", (None,), "biuf")
    index, force_n, stroke = [np.empty(0, int)], [np.empty((0, 3))], []
    for key, held in strokes.items():
        place = f"{path}: trajectories[{key!r}]"
        for part in ("indexes", "forces"):
            if not isinstance(held, dict) or part not in held:
                raise ImportFailure(f"{place}: {part}: missing key")
        indexes = _numbers(held["indexes"], f"{place}: indexes", (None,), "iu")
        forces = _numbers(held["forces"], f"{place}: forces", (None, 3), "iuf")
        if len(forces) < len(indexes) - UNLABELLED:
            raise ImportFailure(f"{place}: {len(forces)} forces for {len(indexes)} images")
        n = min(len(indexes), len(forces))
        index.append(indexes[:n].astype(int))
        force_n.append(forces[:n])
        stroke += [str(key)] * n
    indexes = np.concatenate(index)
    if len(indexes) and not (indexes.min() >= 0 and indexes.max() < len(in_contact)):
        raise ImportFailure(f"{path}: indexes up to {indexes.max()}: in_contact has {len(in_contact)} images")
    order = np.argsort(indexes, kind="stable")
    images = [p.name for p in here.glob("dataset_*.pkl") if p.name != FORCES]
    sensors = {image.split("_")[1].removesuffix(".pkl") for image in images}
    if len(sensors) != 1:
        found = f"of {', '.join(sorted(sensors))}" if sensors else "none"
        raise ImportFailure(
            f"{here}: images {found}: expected dataset_SENSOR_00.pkl and so on, of one sensor"
        )
    files = sorted((file_in(folder, f"{name}/{image}") for image in images), key=by_number)
    ordered = (indexes[order], np.concatenate(force_n)[order], np.array(stroke, str)[order])
    return Batch(here.resolve().name if name == "." else name, tuple(files), in_contact, *ordered)


def _batches(folder: Path) -> list[Batch]:
    """The batches at and below a folder, in the order of their names."""
    if not folder.is_dir():
        raise ImportFailure(f"{folder}: no such folder")
    found = [Path(place).relative_to(folder) for place, _, files in os.walk(folder) if FORCES in files]
    if not found:
        raise ImportFailure(f"{folder}: no {FORCES} there or in a folder below it")
    return [_batch(folder, name) for name in sorted(map(Path.as_posix, found))]


def _background(batch: Batch, count: int) -> np.ndarray:
    """The mean of a batch's first images without contact, at most `count`."""
    touched = batch.in_contact
    free = (
        (_decoded(image, place), place)
        for index, image, place in batch.all_images()
        if index < len(touched) and not touched[index]
    )
    chosen = list(islice(free, count))
    if not chosen:
        where = batch.images[0].parent / FORCES
        raise ImportFailure(f"{where}: in_contact: 0 for no image, so there is no background")
    return mean_image(chosen)


def _frames(batches: list[Batch], every: int, by: str, sign: int) -> Iterator[ForceFrame]:
    for batch in batches:
        rows = {}
        for row in range(0, len(batch.index), every):
            rows.setdefault(int(batch.index[row]), []).append(row)
        index = -1
        for index, image, place in batch.all_images():
            for row in rows.pop(index, ()):
                force_n = tuple((sign * batch.force_n[row]).tolist())
                yield ForceFrame(_decoded(image, place), force_n, batch.name, batch.group(row, by), place)
        if rows:
            where = f"{batch.images[-1]}: the last image is {index}"
            raise ImportFailure(f"{where}: {FORCES} has forces for image {min(rows)}")


def import_folder(
    folder: Path | str,
    *,
    pitch_mm: float,
    output: Path | str,
    group_by: str = "batch",
    held_out: tuple[str, ...] = (),
    background_frames: int = 20,
    every: int = 1,
    negate: bool = False,
    height_px: int = 128,
    width_px: int = 128,
    keep_pulls: bool = False,
    progress: bool = True,
) -> Written:
    """Import the batches at and below a folder (layout: see above) into the dataset `output`.

    group_by : "batch" (sphere/batch_1), "probe" (sphere) or "stroke" (sphere/batch_1/0)
    held_out : groups of the test split (default: the last)
    background_frames : the most images without contact that are averaged into a batch's background
    every : take each so-many-th labelled image of a batch
    negate : for forces of which z is negative in compression
    keep_pulls, returns : as in `force_frames.write_forces`

    Raises ImportFailure on anything missing, unreadable or inconsistent.
    """
    folder = Path(folder)
    batches = _batches(folder)
    count = sum(len(range(0, len(batch.index), every)) for batch in batches)
    return write_forces(
        _frames(batches, every, group_by, -1 if negate else 1),
        count,
        {batch.name: _background(batch, background_frames) for batch in batches},
        origin=folder,
        pitch_mm=pitch_mm,
        source=f"recorded: TacBench forces from {folder.resolve().name}",
        output=output,
        held_out=held_out,
        height_px=height_px,
        width_px=width_px,
        keep_pulls=keep_pulls,
        progress=progress,
    )
