"""Recordings on a machine with a force gauge: the protocol that it is told, and what it brings home.

A recording is a folder with poses.csv (sensor/importers/poses.py) and a frame per row (sensor/importers/cnc_frames.py). Normals
and depth are rendered from pose, ball and CAD (sensor/importers/pose_labels.py), forces are the gauge's.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fastac.flow.frames import as_channels
from fastac.models.vision.markers import Detector, MarkerError, Tracked, Tracker
from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.importers import poses
from fastac.sensor.importers.cad import Cad
from fastac.sensor.importers.cnc_frames import BACKGROUND, CncFrames, stem
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.pose_labels import labels
from fastac.sensor.importers.poses import Pose
from fastac.sensor.protocol import stations

POSES = "poses.csv"
Point = tuple[float, float, float]


def planned(scene: Scene, cad: Cad, origin_mm: Point = (0.0, 0.0, 0.0)) -> list[Pose]:
    """The poses and loads of a scene's protocol, z where the ball first touches `cad`, plus `origin_mm`."""
    found, ball_mm = [], scene.protocol.ball_mm
    for station in stations(scene):
        touch = cad.first_touch_mm(ball_mm, station.x_mm, station.y_mm)
        at = np.array([station.x_mm, station.y_mm, touch]) + origin_mm
        for target in station.targets_n:
            found.append(Pose(station.split, len(found), *at.tolist(), station.load_n, *target))
    return found


def write_recording(
    scene: Scene, data: dataset.Dataset, folder: Path, origin_mm: Point, progress: bool
) -> None:
    """Write the samples of a virtual rig as a machine would have recorded them; poses.csv comes last.

    Raises ImportFailure where the folder has something in it, or the data lack the ball's pose.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ImportFailure(f"{folder}: not empty: expected a new folder for the recording")
    known = data.indenter
    if "z_mm" not in known:
        raise ImportFailure(
            f"{scene.name}: sensor.elastomer.mechanics = 'layer': the ball's pose is known of 'fem' only"
        )
    folder.mkdir(parents=True, exist_ok=True)
    frames, rows = CncFrames(folder, scene.sensor), []
    taken = data.frames if data.raw10 is None else data.raw10
    frames.write(BACKGROUND, data.background)
    for i in tqdm(range(len(data)), desc="recording", unit="frame", disable=not progress, leave=False):
        frames.write(stem(i), taken[i])
        at = np.array([known[f"{axis}_mm"][i] for axis in "xyz"]) + origin_mm
        told = [float(known[key][i]) for key in ("load_n", "tangential_x_n", "tangential_y_n")]
        rows.append(Pose(str(data.split[i]), i, *at.tolist(), *told, *data.force_n[i].tolist()))
    poses.write(folder / POSES, rows)


@dataclass(frozen=True)
class Markers:
    """The dots of one gel: where they are in the background, and how they are found again."""

    detector: Detector
    reference_px: np.ndarray
    max_step_px: float

    @classmethod
    def of_background(cls, image: np.ndarray, scene: Scene, path: Path) -> "Markers":
        dots, pitch = scene.sensor.markers, scene.sensor.pitch_mm
        try:
            detector = Detector(2 * dots.radius_mm / pitch)
            reference = detector.detect(image)
            step = dots.spacing_mm / pitch
            Tracker(reference, step)
            return cls(detector, reference, step)
        except MarkerError as error:
            raise ImportFailure(f"{path}: {BACKGROUND}: {error}") from None

    def find(self, image: np.ndarray) -> Tracked:
        """Each frame is a press of its own, so the dots are looked for from where they rest."""
        return Tracker(self.reference_px, self.max_step_px).update(self.detector.detect(image))


def import_recording(
    scene: Scene,
    folder: Path,
    cad: Cad,
    output: Path,
    *,
    ball_mm: float,
    origin_mm: Point = (0.0, 0.0, 0.0),
    raw_size_px: tuple[int, int] | None = None,
    skip_lost: bool = False,
    progress: bool = True,
) -> None:
    """Import the recording in `folder` into the dataset `output`.

    origin_mm : the sensor's origin in the machine's coordinates
    skip_lost : leave samples out, and count them, in which a marker is not found; else that is an error

    The last sample is the background itself: the skin at rest as `cad` has it, in split train, without force.
    Normals and depth are NaN, and not valid, where they are not certain. Raises ImportFailure on anything
    missing, unreadable or inconsistent.
    """
    if not (np.isfinite(ball_mm) and ball_mm > 0):
        raise ImportFailure(f"{folder}: ball_mm = {ball_mm:g}: expected more than 0")
    sensor, frames = scene.sensor, CncFrames(folder, scene.sensor, raw_size_px)
    rows = poses.read(folder / POSES, measured=True)
    background = frames.read(BACKGROUND)
    dots = Markers.of_background(as_channels(background, sensor), scene, folder) if sensor.markers else None

    n, shape = len(rows) + 1, (sensor.height_px, sensor.width_px)
    taken = np.empty((n, *background.shape), background.dtype)
    normals, depth = np.empty((n, *shape, 3), np.float32), np.empty((n, *shape), np.float32)
    valid, kept, tracked = np.empty((n, *shape), bool), [], []
    for pose, where in tqdm(rows, desc="frames", disable=not progress, leave=False):
        at = (pose.x_mm, pose.y_mm, pose.z_mm)
        x_mm, y_mm, z_mm = (float(value) for value in np.subtract(at, origin_mm))
        own = Pose(**vars(pose) | {"x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm})
        if not own.force_z_n > 0:
            raise ImportFailure(f"{where}: force_z_n = {own.force_z_n:g}: expected more than 0, compression")
        i = len(kept)
        normals[i], depth[i], valid[i] = labels(cad, own, ball_mm, where)
        taken[i] = frames.read(stem(own.index))
        if dots is not None:
            position = _positions(dots, as_channels(taken[i], sensor), where, skip_lost)
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


def _positions(dots: Markers, image: np.ndarray, where: str, skip_lost: bool) -> np.ndarray | None:
    """Where the dots are in a frame, (M, 2); None for a frame to skip."""
    try:
        found = dots.find(image)
    except MarkerError as error:
        if skip_lost:
            return None
        raise ImportFailure(f"{where}: {error}") from None
    if not found.lost.any():
        return found.position_px
    if skip_lost:
        return None
    raise ImportFailure(f"{where}: markers: {found.lost.sum()} of {len(found.lost)} lost")
