"""Positioning machine (CNC) with a force gauge: plans the poses of a protocol and imports the recording.

A recording is a folder with the measured poses and forces, poses.csv (poses.py), and a frame for each of its
rows (cnc_frames.py). Ground-truth normals and depth are rendered from pose, ball and CAD (pose_labels.py);
forces are those of the gauge.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.importers import poses
from fastac.sensor.importers.cad import Cad
from fastac.sensor.importers.cnc_frames import BACKGROUND, CncFrames, stem
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.pose_labels import labels
from fastac.sensor.importers.poses import Pose
from fastac.sensor.protocol import stations
from fastac.store.progress import progress_bar

POSES = "poses.csv"
Point = tuple[float, float, float]


def planned_poses(scene: Scene, cad: Cad, origin_mm: Point = (0.0, 0.0, 0.0)) -> list[Pose]:
    """The poses and loads of a scene's protocol in the machine's coordinates, with z at first touch.

    Those of `protocol.ball_mm` alone: a recording is of one ball.

    cad : the undeformed skin; origin_mm : the sensor's origin in the machine's coordinates
    """
    found, ball_mm = [], scene.protocol.ball_mm
    for station in (s for s in stations(scene) if s.ball_mm == ball_mm):
        touch = cad.first_touch_mm(ball_mm, station.x_mm, station.y_mm)
        at = np.array([station.x_mm, station.y_mm, touch]) + origin_mm
        for target in station.targets_n:
            found.append(Pose(station.split, len(found), *at.tolist(), station.load_n, *target))
    return found


def write_recording(
    scene: Scene, data: dataset.Dataset, folder: Path, origin_mm: Point, progress: bool
) -> None:
    """Write a simulated dataset as a recording in `folder`, as a machine would have recorded it.

    poses.csv is written last. Raises ImportFailure where the folder is not empty, or the dataset has no z of
    the ball.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ImportFailure(f"{folder}: not empty: expected a new folder for the recording")
    known = data.indenter
    if "z_mm" not in known:
        raise ImportFailure(
            f"{scene.name}: sensor.elastomer.mechanics = 'layer': the ball's pose is known of 'fem' only"
        )
    balls_mm = np.unique(known["ball_mm"])
    if len(balls_mm) > 1:
        raise ImportFailure(
            f"{scene.name}: protocol.more_balls_mm: {len(balls_mm)} balls: expected one, as a recording has"
        )
    folder.mkdir(parents=True, exist_ok=True)
    frames, rows = CncFrames(folder, scene.sensor), []
    taken = data.frames if data.raw10 is None else data.raw10
    frames.write(BACKGROUND, data.background)
    for i in progress_bar(range(len(data)), desc="recording", unit="frame", enabled=progress):
        frames.write(stem(i), taken[i])
        at = np.array([known[f"{axis}_mm"][i] for axis in "xyz"]) + origin_mm
        told = [float(known[key][i]) for key in ("load_n", "tangential_x_n", "tangential_y_n")]
        rows.append(Pose(str(data.split[i]), i, *at.tolist(), *told, *data.force_n[i].tolist()))
    poses.write(folder / POSES, rows)


class MarkerFinder(Protocol):
    """Finds the markers of one gel in its frames, as `models.vision.markers.Markers`."""

    reference_px: np.ndarray
    """(M, 2) positions (u, v) in the background frame."""

    def find(self, image: np.ndarray):
        """The markers in a frame: `.position_px` (M, 2) and `.lost` (M,); raises ValueError where none is
        found."""


def import_recording(
    scene: Scene,
    folder: Path,
    cad: Cad,
    output: Path,
    *,
    ball_mm: float,
    origin_mm: Point = (0.0, 0.0, 0.0),
    raw_size_px: tuple[int, int] | None = None,
    marker_finder_of: Callable[[np.ndarray], MarkerFinder] | None = None,
    skip_lost: bool = False,
    progress: bool = True,
) -> None:
    """Import the machine's recording in `folder` into the dataset `output`.

    ball_mm : the ball's diameter
    origin_mm : the sensor's origin in the machine's coordinates
    raw_size_px : height and width of packed RAW10 images; None: those of the scene's window
    marker_finder_of : makes the marker finder from the background frame, and raises ValueError where that
        shows no dots; None where the skin has no markers
    skip_lost : leave out, and count, samples in which a marker is not found; otherwise that is an error

    The last sample is the background frame itself, in split train: the undeformed skin of `cad`, and no
    force. Where normals and depth are not certain they are NaN and not valid. Raises ImportFailure on
    anything missing, unreadable or inconsistent.
    """
    if not (np.isfinite(ball_mm) and ball_mm > 0):
        raise ImportFailure(f"{folder}: ball_mm = {ball_mm:g}: expected more than 0")
    sensor, frames = scene.sensor, CncFrames(folder, scene.sensor, raw_size_px)
    rows = poses.read(folder / POSES, measured=True)
    background = frames.read(BACKGROUND)
    try:
        dots = marker_finder_of(background) if marker_finder_of else None
    except ValueError as error:
        raise ImportFailure(f"{folder}: {BACKGROUND}: {error}") from None

    n, shape = len(rows) + 1, (sensor.height_px, sensor.width_px)
    taken = np.empty((n, *background.shape), background.dtype)
    normals, depth = np.empty((n, *shape, 3), np.float32), np.empty((n, *shape), np.float32)
    valid, kept, tracked = np.empty((n, *shape), bool), [], []
    for pose, where in progress_bar(rows, desc="frames", enabled=progress):
        at = (pose.x_mm, pose.y_mm, pose.z_mm)
        x_mm, y_mm, z_mm = (float(value) for value in np.subtract(at, origin_mm))
        own = Pose(**vars(pose) | {"x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm})
        if not own.force_z_n > 0:
            raise ImportFailure(f"{where}: force_z_n = {own.force_z_n:g}: expected more than 0, compression")
        i = len(kept)
        normals[i], depth[i], valid[i] = labels(cad, own, ball_mm, where)
        taken[i] = frames.read(stem(own.index))
        if dots is not None:
            position = _positions(dots, taken[i], where, skip_lost)
            if position is None:
                continue
            tracked.append(position)
        kept.append(own)
    if not kept:
        raise ImportFailure(f"{folder}: markers: lost in every sample")
    m = len(kept)
    taken[m], normals[m], depth[m], valid[m] = background, cad.normals(), cad.rest_depth_mm, True
    about = {key: [getattr(pose, key) for pose in kept] for key in poses.COLUMNS[2:8]}
    about["ball_mm"] = [ball_mm] * m
    dataset.write(
        output,
        pitch_mm=sensor.pitch_mm,
        channels=sensor.channel_names,
        source=f"recorded: machine, {folder.name}",
        background=background,
        split=np.array([*(pose.split for pose in kept), "train"]),
        normals=normals[: m + 1],
        depth_mm=depth[: m + 1],
        valid=valid[: m + 1],
        force_n=np.array([*([getattr(p, key) for key in poses.MEASURED] for p in kept), [0.0] * 3]),
        rest_depth_mm=cad.rest_depth_mm,
        indenter={key: np.array([*values, np.nan]) for key, values in about.items()},
        markers_px=None if dots is None else np.array([*tracked, dots.reference_px]),
        left_out=len(rows) - m,
        **{"frames" if sensor.frames == "channels" else "raw10": taken[: m + 1]},
    )


def _positions(dots: MarkerFinder, image: np.ndarray, where: str, skip_lost: bool) -> np.ndarray | None:
    """Positions of the markers in a frame, (M, 2); None for a frame to leave out."""
    try:
        found = dots.find(image)
    except ValueError as error:
        if skip_lost:
            return None
        raise ImportFailure(f"{where}: {error}") from None
    if not found.lost.any():
        return found.position_px
    if skip_lost:
        return None
    raise ImportFailure(f"{where}: markers: {found.lost.sum()} of {len(found.lost)} lost")
