"""Whether intervals hold what they promise: random objects that nothing has been learned from.

A small virtual sensor learns forces from some random objects, its intervals are calibrated on others, and how
many forces are within their intervals is counted on others still. Everything is simulated.
"""

from pathlib import Path

from fastac.flow.build import Build
from fastac.models.integer.force_interval import INTERVAL
from fastac.models.interval_accuracy import lines
from fastac.scenes.schema import Scene
from fastac.store.files import read_json, write_json
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.studies.robustness import random_objects

OBJECTS = {"train": 100, "validation": 1000, "test": 1000}
PRESSES = 3
SIDE_PX, WIDTH_MM = 40, 16.0


def scene_of(coverage: float, outputs: tuple[str, ...] = ("force_xyz",)) -> Scene:
    """A curved fingertip of 40 × 40 pixels whose force is a weighted sum of the slopes."""
    return Scene.model_validate(
        {
            "name": "coverage",
            "outputs": outputs,
            "sensor": {
                "geometry": "fingertip",
                "height_px": SIDE_PX,
                "width_px": SIDE_PX,
                "pitch_mm": WIDTH_MM / SIDE_PX,
                "channels": "bgr+nir",
            },
            "numbers": {"activation_bits": 10},
            "poisson": {"solver": "adjoint"},
            "force": {"clamp": False, "fit": "slopes", "coverage": coverage},
        }
    )


def measure(
    folder: Path,
    *,
    coverage: float = 0.9,
    objects: dict[str, int] = OBJECTS,
    seed: int = 1,
    progress: bool = True,
) -> dict:
    """Train, calibrate and count; writes coverage.json into `folder` and returns its content.

    objects : how many there are in each split
    """
    scene = scene_of(coverage)
    arguments = {"scene": scene, "counts": objects, "presses": PRESSES, "seed": seed}
    step = Step("objects", random_objects.write, arguments, ("data.h5",), {"progress": progress})
    data = open_store(folder.parent / "store").perform(step).path("data.h5")
    build = Build(scene, folder, data, progress=progress)
    build.run(lambda name, state: None, until="evaluate")
    content = {
        "objects": objects,
        "presses": PRESSES,
        "seed": seed,
        INTERVAL: read_json(folder / "accuracy.json")[INTERVAL],
    }
    write_json(folder / "coverage.json", content)
    return content


def report(content: dict) -> list[str]:
    """What `measure` found, to print."""
    counts = ", ".join(f"{count} {split}" for split, count in content["objects"].items())
    return [f"objects: {counts}; {content['presses']} presses of each", *lines(content[INTERVAL])]
