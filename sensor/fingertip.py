"""The virtual fingertip: simulates the paper's press protocol on a scene's sensor and writes a dataset.

Contact mechanics (sensor/mechanics) gives the deformed skin and the force for each load of the protocol
(sensor/protocol.py); optics (sensor/optics) renders the frame. Normals, forces and poses are always stored,
depth only if the scene has a depth solver. The paper has normals and depth of vertical presses only; here
those under tangential load are known too and are stored. Loads that friction, or an object of random shape,
cannot carry are left out, and their number is stored as `left_out`.
"""

import multiprocessing
import os
from pathlib import Path

import numpy as np

from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor import dataset
from fastac.sensor.geometry import rest_depth_mm
from fastac.sensor.mechanics.press import ContactError, PressedSkin, Rig
from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.optics.camera import background, render
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.sensor.optics.mosaic import CELL
from fastac.sensor.optics.raw_window import background_raw10, render_raw10
from fastac.sensor.protocol import FingertipError, stations
from fastac.store.progress import progress_bar


def require_simulated(scene: Scene, what: str, axes: tuple[int, ...]) -> None:
    """Raise FingertipError unless the scene is simulated and outputs the forces along `axes` (0 to 2: x to
    z).

    what : the demo or study that needs them, which begins the message
    """
    if scene.sensor.source != "simulated":
        raise FingertipError(f"{what}: sensor.source = {scene.sensor.source!r}: expected 'simulated'")
    if not set(axes) <= set(scene.force_axes):
        wanted = "force_xyz" if len(axes) > 1 else "force_z or force_xyz"
        raise FingertipError(f"{what}: outputs = {', '.join(scene.outputs)}: expected {wanted}")


def require_friction(scene: Scene, what: str) -> None:
    """Raise FingertipError unless the scene is simulated with friction and has all three axes of force.

    what : as in `require_simulated`
    """
    require_simulated(scene, what, (0, 1, 2))
    if not scene.sensor.elastomer.friction:
        raise FingertipError(f"{what}: sensor.elastomer.friction = 0: expected more, and mechanics 'fem'")


STORE = Path("build/store")
"""Default folder of the step store, which keeps finite-element compliances."""

_rig: Rig | None = None
"""The gel of this worker process."""


def _start_worker(sensor: Sensor, store: Path) -> None:
    global _rig
    _rig = rig_of(sensor, store, progress=False)


def _press(task) -> list[dict | None]:
    """The samples of a station, see `sample`; None for a load that is left out."""
    station, sensor, seeds = task
    try:
        presses = _rig.presses(station)
    except ContactError:
        if station.shape == "ball":
            raise
        return [None] * len(seeds)
    return [
        None if isinstance(pressed, ContactError) else sample(pressed, sensor, np.random.default_rng(seed))
        for pressed, seed in zip(presses, seeds, strict=True)
    ]


def sample(pressed: PressedSkin, sensor: Sensor, rng: np.random.Generator) -> dict:
    """One sample of a dataset, with a rendered frame; the keys are those of `_empty`, and `pose`."""
    view = render if sensor.frames == "channels" else render_raw10
    arrays = {
        "frame": view(pressed.normals, pressed.depth_mm, sensor, rng, pressed.tangential_mm),
        "normals": pressed.normals.astype(np.float32),
        "depth_mm": pressed.depth_mm.astype(np.float32),
        "force_n": pressed.force_n,
    }
    if sensor.markers is not None:
        arrays["markers_px"] = marker_pixels(sensor, pressed.tangential_mm)
        if pressed.tangential_mm is not None:
            arrays["tangential_mm"] = pressed.tangential_mm.astype(np.float32)
    return {**arrays, "pose": pressed.pose}


def _empty(scene: Scene, count: int) -> dict[str, np.ndarray]:
    """Uninitialised arrays for `count` samples, with the arrays that the scene's dataset holds."""
    sensor = scene.sensor
    image = (count, sensor.height_px, sensor.width_px)
    if sensor.frames == "raw10":
        frame = np.empty((count, CELL * sensor.height_px, CELL * sensor.width_px), np.uint16)
    else:
        frame = np.empty((*image, len(sensor.channel_names)), np.uint8)
    room = {"frame": frame, "normals": np.empty((*image, 3), np.float32), "force_n": np.empty((count, 3))}
    if scene.wants_solver:
        room["depth_mm"] = np.empty(image, np.float32)
    if sensor.markers is not None:
        room["markers_px"] = np.empty((count, len(marker_pixels(sensor)), 2))
        if sensor.elastomer.mechanics == "fem":
            room["tangential_mm"] = np.empty((*image, 2), np.float32)
    return room


def _perform(scene: Scene, tasks: list, store: Path, processes: int, progress: bool):
    """Yield the samples of each task, in order; the worker processes start once the compliance is stored."""
    global _rig
    if processes == 1 or scene.sensor.elastomer.mechanics == "fem":
        _rig = rig_of(scene.sensor, store, progress=progress)
    if processes == 1:
        yield from map(_press, tasks)
        return
    _rig = None
    context = multiprocessing.get_context("spawn")
    with context.Pool(processes, _start_worker, (scene.sensor, store)) as pool:
        yield from pool.imap(_press, tasks, chunksize=4)


def generate(
    scene: Scene,
    path: Path | str,
    *,
    store: Path | str = STORE,
    progress: bool = True,
    processes: int | None = None,
) -> None:
    """Simulate the scene's press protocol on its virtual sensor and write the dataset to `path`.

    The result depends on the scene alone, not on the number of processes (default: one per core). `store`
    is the folder of the step store, which keeps finite-element compliances. Raises FingertipError if the
    scene's sensor is a recorded one or too small for the ball, and ContactError if a ball's vertical load
    exceeds what the contact model can represent.
    """
    sensor, protocol = scene.sensor, scene.protocol
    if sensor.source != "simulated":
        raise FingertipError(f"{scene.name}: sensor.source = {sensor.source!r}: expected 'simulated'")
    visited = stations(scene)
    count = sum(len(station.targets_n) for station in visited)
    background_seed, *seeds = np.random.SeedSequence(protocol.seed).spawn(count + 1)
    rest, left_out = iter(seeds), 0
    tasks = [(s, sensor, [next(rest) for _ in s.targets_n]) for s in visited]
    room, poses, split, group = _empty(scene, count), [], [], []
    processes = min(processes or os.cpu_count() or 1, len(tasks))
    with progress_bar(total=count, desc="presses", unit="", enabled=progress, leave=True) as bar:
        performed = _perform(scene, tasks, Path(store), processes, progress)
        for station, samples in zip(visited, performed, strict=True):
            for found in samples:
                bar.update()
                if found is None:
                    left_out += 1
                    continue
                for key, array in room.items():
                    array[len(poses)] = found[key]
                poses.append(found["pose"])
                split.append(station.split)
                group.append(station.group)

    arrays = {key: array[: len(poses)] for key, array in room.items()}
    frames, take = ("frames", background) if sensor.frames == "channels" else ("raw10", background_raw10)
    dataset.write(
        path,
        pitch_mm=sensor.pitch_mm,
        channels=sensor.channel_names,
        source=f"simulated: virtual {sensor.geometry}, seed {protocol.seed}",
        background=take(sensor, np.random.default_rng(background_seed)),
        split=np.array(split),
        group=np.array(group) if protocol.more_shapes else None,
        indenter={key: np.array([pose[key] for pose in poses]) for key in poses[0]},
        rest_depth_mm=rest_depth_mm(sensor) if scene.wants_slopes else None,
        left_out=left_out,
        **{frames: arrays.pop("frame")},
        **arrays,
    )
