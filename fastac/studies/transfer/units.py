"""Other units of a scene's virtual sensor: what differs from one to the next, drawn by number."""

from pathlib import Path

import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor.protocol import FingertipError
from fastac.sweep.spec import point_of

DIFFERENCES = {
    "light": {
        "sensor.light.distance_mm": 0.06,
        "sensor.light.below_mm": 0.06,
        "sensor.light.softening_mm": 0.1,
        "sensor.light.ambient": 0.2,
        "sensor.light.brightest_dn": 0.08,
    },
    "coat": {"sensor.grain": 0.3},
    "gel": {"sensor.elastomer.modulus_mpa": 0.15, "sensor.elastomer.thickness_mm": 0.05},
    "camera": {"sensor.noise_dn": 0.3, "sensor.electrons_per_dn": 0.2},
}
"""By what they belong to, the scene's keys that differ, and by which share of their value at most: assumed
tolerances of a sensor that is made by hand, uniformly distributed."""
SPECULAR = 0.05
"""A coat may shine: its specular share is up to so much larger."""


def unit_of(scene: Scene, number: int) -> Scene:
    """The scene with the sensor of unit `number`, from 1 on; the same for the same number.

    Its presses have noise of their own, too. Raises FingertipError for a sensor that is not simulated.
    """
    if scene.sensor.source != "simulated":
        raise FingertipError(f"sensor.source = {scene.sensor.source!r}: expected 'simulated'")
    rng = np.random.default_rng([number, scene.protocol.seed])
    choice = {
        key: round(float(scene.value_at(key)) * (1 + share * rng.uniform(-1, 1)), 6)
        for keys in DIFFERENCES.values()
        for key, share in keys.items()
    }
    shine = scene.sensor.light.specular + SPECULAR * rng.uniform()
    choice |= {
        "sensor.light.specular": round(shine, 6),
        "protocol.seed": scene.protocol.seed + number,
    }
    found = point_of(scene, choice, Path())
    if found.scene is None:
        raise FingertipError(f"unit {number}: {found.error}")
    return found.scene
