"""Times of the virtual rig on one core: a contact, its pixels, a frame, and the frame's processing.

`fastac bench rig SCENE` prints them. The compliance is computed first, or taken from the
store, and not timed.
"""

from functools import partial
from pathlib import Path

import numpy as np

from fastac.models.vision import image_processing
from fastac.report.tables import text_table
from fastac.scenes.schema import Scene, SceneError
from fastac.sensor.mechanics.fem.pressed_gel import GelContact
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.fem.skin import skin_of
from fastac.sensor.mechanics.random_indenter import indenter_of
from fastac.sensor.optics.camera import render
from fastac.sensor.optics.raw_window import render_raw10
from fastac.sensor.protocol import stations
from fastac.studies.benchmarks.timing import fastest

STATIONS, REPEATS = 5, 5


HEAD = ("part", "mean, ms", "largest, ms", "processor, mean, ms")


def cells(name: str, times: list[tuple[float, float]]) -> list[str]:
    """A row of the table: mean and largest over the stations, of the fastest run at each."""
    wall_ms, processor_ms = 1e3 * np.array(times).T
    return [name, *(f"{value:.2f}" for value in (wall_ms.mean(), wall_ms.max(), processor_ms.mean()))]


def measure(scene: Scene, store: Path, progress: bool) -> str:
    """A table with a row for each part, timed at a few stations spread over the protocol."""
    sensor = scene.sensor
    if sensor.elastomer.mechanics != "fem":
        raise SceneError(f"{scene.name}: sensor.elastomer.mechanics = 'layer': expected 'fem'")
    rig, friction = FemRig(sensor, store, progress=progress), sensor.elastomer.friction
    visited = stations(scene)
    chosen = [visited[i] for i in np.linspace(0, len(visited) - 1, STATIONS).astype(int)]
    times: dict[str, list] = {}
    for station in chosen:
        drags, indenter = station.tangential_n, indenter_of(station)
        press = partial(
            rig.gel.presses, indenter, station.x_mm, station.y_mm, load_n=station.load_n, friction=friction
        )
        times.setdefault("vertical contact", []).append(fastest(press, REPEATS))
        if drags:
            spent = np.array(fastest(partial(press, tangential_loads_n=drags), REPEATS)) / (1 + len(drags))
            times.setdefault("contact, mean of all loads", []).append(tuple(spent))
        contact: GelContact = press()[0]
        pixels = partial(skin_of, contact, sensor, indenter, station.x_mm, station.y_mm)
        times.setdefault("skin at the pixels", []).append(fastest(pixels, REPEATS))
        skin, rng = pixels(), np.random.default_rng(1)
        state = (skin.normals, skin.depth_mm, sensor, rng, skin.tangential_mm)
        times.setdefault("frame of channels", []).append(fastest(partial(render, *state), REPEATS))
        if sensor.frames == "raw10":
            raw = render_raw10(*state)
            times.setdefault("RAW10 frame", []).append(fastest(partial(render_raw10, *state), REPEATS))
            process = partial(image_processing.channels, raw, sensor)
            times.setdefault("image processing", []).append(fastest(process, REPEATS))
    return text_table(HEAD, [cells(name, found) for name, found in times.items()])
