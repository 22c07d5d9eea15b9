"""What bundles find of objects that nothing was trained on: the errors of the force, kind by kind.

Objects of random size of each kind (sensor/mechanics/random_indenter.py), and bottles, are pressed at random
places of the virtual fingertip with random loads and dragged, and no protocol draws the same ones. Every
bundle's integers find the forces in the same frames. Everything is simulated.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.report.tables import Table
from fastac.scenes.schema import AXES, Scene
from fastac.sensor.fingertip import require_friction
from fastac.sensor.mechanics.fem.contact import Load
from fastac.sensor.mechanics.fem.probe import FemProbe
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.indenter import Cylinder, Indenter
from fastac.sensor.mechanics.press import ContactError, PressedSkin
from fastac.sensor.mechanics.random_indenter import KINDS
from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.protocol import FingertipError, region_mm
from fastac.store.files import write_json
from fastac.store.progress import progress_bar

OBJECTS: Mapping[str, Callable[[np.random.Generator], Indenter]] = {
    **KINDS,
    "bottle": lambda rng: Cylinder(rng.uniform(50, 80), 300.0, rng.uniform(0, 180)),
}
"""Makers of a random indenter, by kind. Bottles are longer than the skin is wide, as that of the grasp is."""
LEAST_LOAD = 0.2
"""The smallest load in shares of the protocol's largest."""
MOST_DRAG = 0.9
"""The largest drag in shares of what friction carries."""
ATTEMPTS = 20
"""Draws among which one must be carried by the contact."""


def _press(rig: FemRig, scene: Scene, kind: str, rng: np.random.Generator) -> PressedSkin:
    """One press and drag of a random object; ContactError where the contact cannot carry it."""
    largest_n, friction = max(scene.protocol.loads_n), scene.sensor.elastomer.friction
    indenter = OBJECTS[kind](rng)
    along, down = rng.uniform(size=2)
    upper, lower = region_mm(scene.sensor, scene.protocol)
    left, right = upper + down * (lower - upper)
    probe = FemProbe(rig, indenter, *(left + along * (right - left)))
    load_n = rng.uniform(LEAST_LOAD, 1) * largest_n
    drag_n, angle = rng.uniform(0, MOST_DRAG) * friction * load_n, rng.uniform(0, 2 * np.pi)
    probe.at_load(load_n)
    force_n = np.array([drag_n * np.cos(angle), drag_n * np.sin(angle), load_n])
    probe.apply_load(Load(np.eye(3), np.ones(3, bool), force_n))
    return probe.pressed()


def presses(rig: FemRig, scene: Scene, kind: str, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Frames (count, H, W, C) uint8 and true forces (count, 3) of objects of a kind, each pressed once.

    Raises ContactError where none of ATTEMPTS draws is carried.
    """
    images, forces = [], []
    for k in range(count):
        rng = np.random.default_rng((seed, list(OBJECTS).index(kind), k))
        for attempt in range(ATTEMPTS):
            try:
                pressed = _press(rig, scene, kind, rng)
                break
            except ContactError:
                if attempt == ATTEMPTS - 1:
                    raise
        images.append(frames.of_press(pressed, scene.sensor, rng))
        forces.append(pressed.force_n)
    return np.array(images), np.array(forces)


def errors(found_n: np.ndarray, true_n: np.ndarray) -> dict:
    """Errors of forces (n, 3): mean absolute ones in N, and how much too large or small each axis comes out.

    gain : Σ found·true / Σ true², 1 without bias, of the shear (F_x and F_y) and of F_z
    friction_ratio : median of the found F_s/F_n over the true one, over the half with the larger drags
    """
    shear, normal = found_n[:, :2] * true_n[:, :2], found_n[:, 2] * true_n[:, 2]
    true_ratio, found_ratio = (np.hypot(f[:, 0], f[:, 1]) / f[:, 2] for f in (true_n, found_n))
    dragged = true_ratio >= np.median(true_ratio)
    return {
        "mae_n": dict(zip(AXES, np.abs(found_n - true_n).mean(axis=0).tolist(), strict=True)),
        "gain": {
            "shear": float(shear.sum() / (true_n[:, :2] ** 2).sum()),
            "normal": float(normal.sum() / (true_n[:, 2] ** 2).sum()),
        },
        "friction_ratio": float(np.median(found_ratio[dragged] / true_ratio[dragged])),
    }


def run(
    named: Mapping[str, Bundle],
    folder: Path,
    *,
    count: int = 40,
    seed: int = 1,
    store: Path = frames.STORE,
    progress: bool = True,
) -> dict:
    """Press `count` objects of each kind, find the forces with each bundle; write shapes.json into `folder`.

    named : bundles by their names in the table, all of one sensor
    Returns the JSON's content. Raises FingertipError for bundles of several sensors, or scenes without
    friction or three axes of force.
    """
    scenes = {name: bundle.scene for name, bundle in named.items()}
    first = next(iter(scenes.values()))
    for name, scene in scenes.items():
        require_friction(scene, "study shapes")
        if scene.sensor != first.sensor:
            raise FingertipError(f"study shapes: {name}: sensor: expected that of {next(iter(scenes))}")
    rig = rig_of(first.sensor, store, progress=progress)
    by_kind: dict[str, dict] = {}
    for kind in progress_bar(OBJECTS, desc="shapes", unit="kind", enabled=progress):
        images, true_n = presses(rig, first, kind, count, seed)
        by_kind[kind] = {
            name: errors(Emulator(bundle.pipeline).run(images, wanted=("force_n",)).force_n, true_n)
            for name, bundle in named.items()
        }
    trained = {
        name: {"balls_mm": [s.protocol.ball_mm, *s.protocol.more_balls_mm], "shapes": s.protocol.more_shapes}
        for name, s in scenes.items()
    }
    content = {
        "source": "simulated",
        "bundles": {name: bundle.digest for name, bundle in named.items()},
        "trained_on": trained,
        "objects": count,
        "seed": seed,
        "by_kind": by_kind,
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "shapes.json", content)
    return content


def _trained_on(about: Mapping) -> str:
    balls = ", ".join(f"{ball_mm:g}" for ball_mm in about["balls_mm"])
    shapes: Sequence[str] = about["shapes"]
    return ", ".join([f"balls of {balls} mm", *shapes])


def tables(content: dict) -> list[Table]:
    """One table for each kind of object, a row a bundle, from the content of shapes.json."""
    rows = [
        [
            kind,
            name,
            "yes" if kind == "ball" or kind in content["trained_on"][name]["shapes"] else "no",
            *(f"{1000 * error:.0f}" for error in one["mae_n"].values()),
            *(f"{gain:.2f}" for gain in one["gain"].values()),
            f"{one['friction_ratio']:.2f}",
        ]
        for kind, bundles in content["by_kind"].items()
        for name, one in bundles.items()
    ]
    note = "; ".join(f"{name}: trained on {_trained_on(x)}" for name, x in content["trained_on"].items())
    head = ["object", "bundle", "kind trained on", *(f"error F_{axis}, mN" for axis in AXES)]
    head += ["found/true: shear", "F_z", "F_s/F_n"]
    return [Table(f"{content['objects']} new objects of each kind", head, rows, f"{note}; simulated")]
