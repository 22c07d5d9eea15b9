"""Presses of random objects on the virtual sensor's elastic layer: a dataset whose groups are the objects.

Balls, cylinders, edges, round punches and lumps of random size, each pressed at a few random places with
random loads. An object whose contact the layer's model cannot represent is drawn anew.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.fingertip import sample
from fastac.sensor.geometry import deformed_slopes, normals_from_slopes, rest_depth_mm
from fastac.sensor.mechanics.indenter import Ball, Cylinder, Edge, FlatPunch, HeightMap, Indenter
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.press import ContactError, PressedSkin
from fastac.sensor.optics.camera import background
from fastac.store.progress import progress_bar

LOADS_N = (0.1, 1.0)
REACH = 0.2
"""Of the image's width: how far along x and y presses are from the middle, at most."""
LUMP_PITCH_MM = 0.1


def lump(rng: np.random.Generator) -> HeightMap:
    """A bowl with waves on it, 8 mm wide."""
    x, y = np.meshgrid(*(np.arange(-4, 4 + LUMP_PITCH_MM / 2, LUMP_PITCH_MM),) * 2)
    height = x**2 / (2 * rng.uniform(2, 8)) + y**2 / (2 * rng.uniform(2, 8))
    angle, phase = rng.uniform(0, 2 * np.pi, 2)
    along = np.cos(angle) * x + np.sin(angle) * y
    waves = rng.uniform(0.02, 0.1) * np.cos(2 * np.pi * along / rng.uniform(1.5, 4) + phase)
    return HeightMap(height + waves, LUMP_PITCH_MM)


KINDS: dict[str, Callable[[np.random.Generator], Indenter]] = {
    "ball": lambda rng: Ball(rng.uniform(3, 8)),
    "cylinder": lambda rng: Cylinder(rng.uniform(3, 8), rng.uniform(3, 8), rng.uniform(0, 180)),
    "edge": lambda rng: Edge(
        rng.uniform(3, 7), rng.uniform(90, 150), rng.uniform(0.2, 0.6), rng.uniform(0, 180)
    ),
    "punch": lambda rng: FlatPunch(rng.uniform(2, 5)),
    "lump": lump,
}
"""Makers of a random indenter, by kind."""


def press(layer: Layer, indenter: Indenter, x_mm: float, y_mm: float, load_n: float) -> PressedSkin:
    """The skin under an indenter whose axis is at (x_mm, y_mm). Raises ContactError as `Layer`."""
    z, p_object, q_object = indenter.surface(layer.x_mm - x_mm, layer.y_mm - y_mm)
    contact = layer.press_surface(z, load_n=load_n)
    p, q = deformed_slopes(contact.displacement_mm, layer.sensor)
    touching = contact.pressure_mpa > 0
    p[touching], q[touching] = p_object[touching], q_object[touching]
    force = contact.pressure_mpa * layer.sensor.pitch_mm**2
    depth_mm = layer.rest_depth_mm - contact.displacement_mm
    force_n = np.array([-(p * force).sum(), -(q * force).sum(), force.sum()])
    pose = {"x_mm": x_mm, "y_mm": y_mm, "approach_mm": contact.approach_mm}
    return PressedSkin(normals_from_slopes(p, q), depth_mm, touching, force_n, pose)


def write(
    folder: Path, scene: Scene, counts: dict[str, int], presses: int, seed: int, *, progress: bool = False
) -> None:
    """A step: `data.h5` with so many objects in each split, in turn of each kind, and `presses` of each."""
    sensor, layer = scene.sensor, Layer(scene.sensor)
    span = REACH * sensor.width_px * sensor.pitch_mm
    found, split, group = [], [], []
    kinds = list(KINDS)
    with progress_bar(total=sum(counts.values()), desc="objects", unit="", enabled=progress) as bar:
        for part, (name, count) in enumerate(counts.items()):
            for k in range(count):
                kind = kinds[k % len(kinds)]
                rng = np.random.default_rng((seed, part, k))
                samples = None
                while samples is None:
                    samples = _samples(scene, layer, KINDS[kind](rng), span, presses, rng)
                found += samples
                split += [name] * presses
                group += [f"{name} {kind} {k}"] * presses
                bar.update()
    arrays = {key: np.stack([one[key] for one in found]) for key in ("frame", "normals", "force_n")}
    if scene.wants_solver:
        arrays["depth_mm"] = np.stack([one["depth_mm"] for one in found])
    dataset.write(
        folder / "data.h5",
        pitch_mm=sensor.pitch_mm,
        channels=sensor.channel_names,
        source=f"simulated: random objects, seed {seed}",
        background=background(sensor, np.random.default_rng(seed)),
        split=np.array(split),
        group=np.array(group),
        rest_depth_mm=rest_depth_mm(sensor),
        frames=arrays.pop("frame"),
        **arrays,
    )


def _samples(
    scene: Scene, layer: Layer, indenter: Indenter, span: float, presses: int, rng: np.random.Generator
) -> list[dict] | None:
    """Samples of one object; None where the layer cannot carry one of them."""
    found = []
    for _ in range(presses):
        x_mm, y_mm = rng.uniform(-span, span, 2)
        try:
            pressed = press(layer, indenter, x_mm, y_mm, rng.uniform(*LOADS_N))
        except ContactError:
            return None
        found.append(sample(pressed, scene.sensor, rng))
    return found
