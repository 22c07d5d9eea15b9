"""Presses of random objects on the virtual sensor's elastic layer: a dataset whose groups are the objects.

Balls, cylinders, edges, round punches and lumps of random size, each pressed at a few random places with
random loads. An object whose contact the layer's model cannot represent is drawn anew.
"""

from pathlib import Path

import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.fingertip import sample
from fastac.sensor.geometry import rest_depth_mm
from fastac.sensor.mechanics.indenter import Indenter
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.layer_rig import press_indenter
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.mechanics.random_indenter import KINDS
from fastac.sensor.optics.camera import background
from fastac.store.progress import progress_bar

LOADS_N = (0.1, 1.0)
REACH = 0.2
"""Of the image's width: how far along x and y presses are from the middle, at most."""


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
            pressed = press_indenter(layer, indenter, x_mm, y_mm, rng.uniform(*LOADS_N))
        except ContactError:
            return None
        found.append(sample(pressed, scene.sensor, rng))
    return found
