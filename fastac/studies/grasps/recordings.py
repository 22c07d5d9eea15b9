"""Recordings of objects on a virtual flat gel with a force gauge, as a laboratory without geometry has them.

Each object is a recording: it is pressed at random places, from light to heavy, and left alone between them.
What differs from recording to recording and from press to press, besides the object, is the light.
"""

from pathlib import Path

import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.mechanics.indenter import Ball, Cylinder, Edge, FlatPunch, HeightMap, Indenter
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.layer_rig import press_indenter
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.optics.camera import background, render
from fastac.sensor.optics.faults import gain
from fastac.sensor.protocol import FingertipError
from fastac.store.progress import progress_bar
from fastac.studies.depth.presses import GEL

SIDE_PX, WIDTH_MM = 40, 16.0
LOADS_N = (0.1, 2.5)
STEPS = 8
"""Frames of a press, of loads evenly apart up to its largest."""
LEAST_SHARE = 0.3
"""Of the largest load: what a press reaches at least."""
REST_FRAMES = 24
"""Of each recording, of the untouched gel."""
REACH = 0.2
"""Of the image's width: how far along x and y presses are from its middle, at most."""
RECORDING_GAIN, PRESS_GAIN = 0.01, 0.004
"""Standard deviations of each channel's gain, from recording to recording and from press to press."""
RECORDINGS = "recordings.h5"
BUMP_PITCH_MM = 0.1


def _bumps(count: int, bump_mm: float, apart_mm: float) -> HeightMap:
    """Balls of a diameter side by side on a circle, so that neighbours are `apart_mm` from each other."""
    axis = np.arange(-5, 5 + BUMP_PITCH_MM / 2, BUMP_PITCH_MM)
    x, y = np.meshgrid(axis, axis)
    angles = 2 * np.pi * np.arange(count) / count
    radius = apart_mm / (2 * np.sin(np.pi / count))
    height = [
        (np.square(x - radius * np.cos(a)) + np.square(y - radius * np.sin(a))) / bump_mm for a in angles
    ]
    return HeightMap(np.min(height, axis=0), BUMP_PITCH_MM)


OBJECTS: dict[str, Indenter] = {
    "ball of 3 mm": Ball(3),
    "ball of 7 mm": Ball(7),
    "rod of 2 mm": Cylinder(2, 8, 30),
    "can of 12 mm": Cylinder(12, 8, 70),
    "coin of 4 mm": FlatPunch(4),
    "edge": Edge(6, 120, 0.3, 110),
    "three bumps": _bumps(3, 2.5, 3.0),
    "four bumps": _bumps(4, 3.0, 2.5),
}


def virtual(scene: Scene) -> Scene:
    """A small virtual gel with a recorded scene's channels, trained from forces alone as the scene says.

    Raises FingertipError for a scene of another kind.
    """
    if scene.sensor.geometry != "flat" or scene.training.labels != "force":
        raise FingertipError(f"{scene.name}: expected a flat gel and training.labels 'force'")
    size = {"height_px": SIDE_PX, "width_px": SIDE_PX, "pitch_mm": WIDTH_MM / SIDE_PX}
    sensor = {"geometry": "flat", "channels": scene.sensor.channels, **size, **GEL}
    kept = scene.model_dump(mode="json", exclude={"sensor", "protocol"})
    return Scene.model_validate({**kept, "name": f"{scene.name}-grasps", "sensor": sensor})


def write(
    folder: Path, scene: Scene, objects: list[str], presses: int, seed: int, *, progress: bool = False
) -> None:
    """A step: the recordings of objects, `presses` of each, as one dataset whose groups they are."""
    sensor = scene.sensor
    layer, untouched = Layer(sensor), background(sensor, np.random.default_rng(seed))
    frames, forces, groups = [], [], []
    with progress_bar(total=len(objects) * presses, desc="presses", unit="", enabled=progress) as bar:
        for name in objects:
            rng = np.random.default_rng((seed, list(OBJECTS).index(name)))
            own = 1 + RECORDING_GAIN * rng.standard_normal(len(sensor.channel_names))
            at_rest = [background(sensor, rng) for _ in range(REST_FRAMES)]
            found = [(gain(frame, own), np.zeros(3)) for frame in at_rest]
            for _ in range(presses):
                lit = own + PRESS_GAIN * rng.standard_normal(len(own))
                found += [(gain(frame, lit), force) for frame, force in _press(layer, OBJECTS[name], rng)]
                bar.update()
            frames += [frame for frame, _ in found]
            forces += [force for _, force in found]
            groups += [name] * len(found)
    dataset.write(
        folder / RECORDINGS,
        pitch_mm=sensor.pitch_mm,
        channels=sensor.channel_names,
        source=f"simulated: objects on a flat gel, seed {seed}",
        background=untouched,
        split=np.full(len(frames), "train"),
        frames=np.stack(frames),
        force_n=np.array(forces),
        group=np.array(groups),
    )


def _press(layer: Layer, indenter: Indenter, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Frames and forces of one press; loads that the gel cannot carry are left out."""
    span = REACH * WIDTH_MM
    x_mm, y_mm = rng.uniform(-span, span, 2)
    largest_n = rng.uniform(LEAST_SHARE, 1) * LOADS_N[1]
    found = []
    for load_n in np.linspace(LOADS_N[0], largest_n, STEPS):
        try:
            skin = press_indenter(layer, indenter, x_mm, y_mm, load_n)
        except ContactError:
            break
        found.append((render(skin.normals, skin.depth_mm, layer.sensor, rng), skin.force_n))
    return found
