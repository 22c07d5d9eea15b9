"""Speed of the virtual rig on one core: contact mechanics, skin at the pixels, rendering, image processing.

    fastac bench rig SCENE [--store FOLDER]

The gel's compliance is computed first, or read from the store; that time is not counted.
"""

from functools import partial
from pathlib import Path

import numpy as np

from fastac.models.vision import image_processing
from fastac.scenes.schema import Scene, SceneError
from fastac.sensor.mechanics.fem.pressed_gel import GelContact
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.fem.skin import skin_of
from fastac.sensor.mechanics.indenter import Ball
from fastac.sensor.optics.camera import render
from fastac.sensor.optics.raw_window import render_raw10
from fastac.sensor.protocol import stations
from fastac.studies.benchmarks.timing import fastest

STATIONS, REPEATS = 5, 5


def line(name: str, times: list[tuple[float, float]]) -> str:
    """One line of the result: mean and maximum over the stations of (wall clock, processor time) in s."""
    wall, processor = 1e3 * np.array(times).T
    spread = f"{wall.mean():8.2f} ms, at most {wall.max():8.2f}"
    return f"  {name:28s} {spread}; {processor.mean():8.2f} ms of processor time"


def measure(scene: Scene, store: Path, progress: bool) -> list[str]:
    """Time each part at a few stations spread over the protocol; returns one line of text per part.

    Raises SceneError unless the scene's elastomer is modelled by finite elements.
    """
    sensor, ball = scene.sensor, Ball(scene.protocol.ball_mm)
    if sensor.elastomer.mechanics != "fem":
        raise SceneError(f"{scene.name}: sensor.elastomer.mechanics = 'layer': expected 'fem'")
    rig, friction = FemRig(sensor, store, progress=progress), sensor.elastomer.friction
    visited = stations(scene)
    chosen = [visited[i] for i in np.linspace(0, len(visited) - 1, STATIONS).astype(int)]
    times: dict[str, list] = {}
    for station in chosen:
        drags = station.tangential_n
        press = partial(
            rig.gel.presses, ball, station.x_mm, station.y_mm, load_n=station.load_n, friction=friction
        )
        times.setdefault("vertical contact", []).append(fastest(press, REPEATS))
        if drags:
            spent = np.array(fastest(partial(press, tangential_loads_n=drags), REPEATS)) / (1 + len(drags))
            times.setdefault("contact, mean of all loads", []).append(tuple(spent))
        contact: GelContact = press()[0]
        pixels = partial(skin_of, contact, sensor, ball, station.x_mm, station.y_mm)
        times.setdefault("skin at the pixels", []).append(fastest(pixels, REPEATS))
        skin, rng = pixels(), np.random.default_rng(1)
        state = (skin.normals, skin.depth_mm, sensor, rng, skin.tangential_mm)
        times.setdefault("frame of channels", []).append(fastest(partial(render, *state), REPEATS))
        if sensor.frames == "raw10":
            raw = render_raw10(*state)
            times.setdefault("RAW10 frame", []).append(fastest(partial(render_raw10, *state), REPEATS))
            process = partial(image_processing.channels, raw, sensor)
            times.setdefault("image processing", []).append(fastest(process, REPEATS))
    return [line(name, found) for name, found in times.items()]
