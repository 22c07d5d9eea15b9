"""The virtual fingertip: ball presses on a simulated sensor, after the paper's protocol.

At each point of three grids that share no point (train, validation, test; supplement, section I) a ball is
pressed vertically at each of the scene's loads. Positions are of the ball's axis, in mm from the image's
centre. The dataset holds normals, forces and poses, which cost nothing, and depth only if the scene has
something to solve for it.
"""

import multiprocessing
import os
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline
from tqdm import tqdm

from fastac.scene import Protocol, Scene, Sensor
from sensor import dataset
from sensor.camera import background, render
from sensor.elastomer import Contact, Layer
from sensor.geometry import ball_slopes, normals_from_slopes, rest_depth_mm, rest_slopes

MARGIN_BALLS = 0.3
"""Distance from the fixed rim to the outermost positions, in ball diameters: as much as the contact grows."""


class FingertipError(ValueError):
    """A scene that the virtual fingertip cannot press; the message is one line with key and value."""


def positions_mm(sensor: Sensor, protocol: Protocol) -> dict[str, np.ndarray]:
    """Positions (n², 2) of the ball's axis, x and y in mm, for each split.

    All three grids are taken from one lattice of 2m × 2m points, m the largest grid: train from the points
    that are even along both axes, test odd along both, validation odd along x and even along y. So no two
    splits come closer than one step of the lattice.
    """
    margin = sensor.elastomer.rim_mm + MARGIN_BALLS * protocol.ball_mm
    half_x = (sensor.width_px - 1) * sensor.pitch_mm / 2 - margin
    half_y = (sensor.height_px - 1) * sensor.pitch_mm / 2 - margin
    if half_x <= 0 or half_y <= 0:
        raise FingertipError(
            f"protocol.ball_mm = {protocol.ball_mm:g}: no room for it between rims of"
            f" {sensor.elastomer.rim_mm:g} mm on {sensor.width_px} x {sensor.height_px} px"
            f" of {sensor.pitch_mm:g} mm"
        )
    sizes = {"train": protocol.train_grid, "validation": protocol.validation_grid, "test": protocol.test_grid}
    parity = {"train": (0, 0), "validation": (1, 0), "test": (1, 1)}
    largest = max(sizes.values())
    positions = {}
    for split, size in sizes.items():
        chosen = np.rint((np.arange(size) + 0.5) / size * largest - 0.5).astype(int)
        along_x, along_y = (2 * (2 * chosen + odd) / (2 * largest - 1) - 1 for odd in parity[split])
        x, y = np.meshgrid(along_x * half_x, along_y * half_y)
        positions[split] = np.stack([x.ravel(), y.ravel()], axis=-1)
    return positions


def surface(contact: Contact, layer: Layer, x_mm: float, y_mm: float, ball_mm: float):
    """The pressed skin: normals (H, W, 3) and depth_mm (H, W), float64.

    Where the skin touches the ball its slopes are the ball's own. Elsewhere they are the untouched
    skin's, in closed form, less the displacement's derivative by a cubic spline.
    """
    sensor = layer.sensor
    rows = np.arange(sensor.height_px) * sensor.pitch_mm
    columns = np.arange(sensor.width_px) * sensor.pitch_mm
    spline = RectBivariateSpline(rows, columns, contact.displacement_mm)
    p, q = rest_slopes(sensor)
    p -= spline(rows, columns, dy=1)
    q -= spline(rows, columns, dx=1)
    touching = contact.pressure_mpa > 0
    p[touching], q[touching] = ball_slopes(layer.x_mm[touching] - x_mm, layer.y_mm[touching] - y_mm, ball_mm)
    return normals_from_slopes(p, q), layer.rest_depth_mm - contact.displacement_mm


def contact_force_n(contact: Contact, layer: Layer, x_mm: float, y_mm: float, ball_mm: float) -> np.ndarray:
    """The skin's force on the ball, (3,) in N, z positive in compression.

    Without friction the pressure acts along the surface's normal: a pressure P on the image's plane gives
    (−p, −q, 1)·P, with the ball's slopes p, q. On a tilted skin a vertical press so has tangential forces.
    """
    touching = contact.pressure_mpa > 0
    p, q = ball_slopes(layer.x_mm[touching] - x_mm, layer.y_mm[touching] - y_mm, ball_mm)
    pressure = contact.pressure_mpa[touching] * layer.sensor.pitch_mm**2
    return np.array([-(p * pressure).sum(), -(q * pressure).sum(), pressure.sum()])


_layer: Layer | None = None
"""The elastomer of this worker process."""


def _start_worker(sensor: Sensor) -> None:
    global _layer
    _layer = Layer(sensor)


def _press(task):
    """One sample of the dataset, from its position, load, ball and seed."""
    (x_mm, y_mm), load_n, ball_mm, seed = task
    contact = _layer.press(x_mm, y_mm, ball_mm=ball_mm, load_n=load_n)
    normals, depth_mm = surface(contact, _layer, x_mm, y_mm, ball_mm)
    frame = render(normals, depth_mm, _layer.sensor, np.random.default_rng(seed))
    pose = (x_mm, y_mm, ball_mm, contact.approach_mm, contact.contact_radius_mm)
    force = contact_force_n(contact, _layer, x_mm, y_mm, ball_mm)
    return frame, normals.astype(np.float32), depth_mm.astype(np.float32), force, pose


def generate(scene: Scene, path: Path | str, *, progress: bool = True, processes: int | None = None) -> None:
    """Press the scene's protocol on its virtual sensor and write the dataset to `path`.

    The result depends on the scene alone, not on the number of processes (default: one per core).
    Raises FingertipError if the scene's sensor is a recorded one or too small for the ball, and
    ContactError if a press is beyond the elastomer's model.
    """
    sensor, protocol = scene.sensor, scene.protocol
    if sensor.source != "simulated":
        raise FingertipError(f"{scene.name}: sensor.source = {sensor.source!r}: expected 'simulated'")
    points = [
        (split, tuple(map(float, position)), load)
        for split, grid in positions_mm(sensor, protocol).items()
        for position in grid
        for load in protocol.loads_n
    ]
    background_seed, *seeds = np.random.SeedSequence(protocol.seed).spawn(len(points) + 1)
    tasks = [
        (position, load, protocol.ball_mm, seed)
        for (_, position, load), seed in zip(points, seeds, strict=True)
    ]
    shape = (len(points), sensor.height_px, sensor.width_px)
    frames = np.empty((*shape, len(sensor.channel_names)), np.uint8)
    normals = np.empty((*shape, 3), np.float32)
    depth_mm = np.empty(shape, np.float32) if scene.wants_solver else None
    force_n, poses = np.empty((len(points), 3)), np.empty((len(points), 5))

    def collect(samples):
        bar = tqdm(samples, total=len(points), desc="presses", unit="", disable=not progress)
        for i, (frame, normal, depth, force, pose) in enumerate(bar):
            frames[i], normals[i], force_n[i], poses[i] = frame, normal, force, pose
            if depth_mm is not None:
                depth_mm[i] = depth

    processes = min(processes or os.cpu_count() or 1, len(points))
    if processes == 1:
        _start_worker(sensor)
        collect(map(_press, tasks))
    else:
        context = multiprocessing.get_context("spawn")
        with context.Pool(processes, _start_worker, (sensor,)) as pool:
            collect(pool.imap(_press, tasks, chunksize=4))

    names = ("x_mm", "y_mm", "ball_mm", "approach_mm", "contact_radius_mm")
    dataset.write(
        path,
        pitch_mm=sensor.pitch_mm,
        channels=sensor.channel_names,
        source=f"simulated: virtual {sensor.geometry}, seed {protocol.seed}",
        background=background(sensor, np.random.default_rng(background_seed)),
        frames=frames,
        split=np.array([split for split, _, _ in points]),
        normals=normals,
        depth_mm=depth_mm,
        force_n=force_n,
        indenter=dict(zip(names, poses.T, strict=True)),
        rest_depth_mm=rest_depth_mm(sensor) if scene.wants_slopes else None,
    )
