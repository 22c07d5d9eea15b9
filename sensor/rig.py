"""A press on either kind of gel: what it makes of the skin, and the force."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from fastac.scenes.schema import Sensor
from fastac.sensor.elastomer import ContactError
from fastac.sensor.protocol import Station


@dataclass(frozen=True)
class Pressed:
    """The skin under a ball."""

    normals: np.ndarray
    """(H, W, 3) float64 outward unit normals."""
    depth_mm: np.ndarray
    """(H, W) float64, z."""
    touching: np.ndarray
    """(H, W) bool: the skin lies against the ball, and its slopes are the ball's."""
    force_n: np.ndarray
    """(3,) the skin's force on the ball, z positive in compression."""
    pose: dict[str, float]
    """What a dataset keeps of the indenter."""
    tangential_mm: np.ndarray | None = None
    """(H, W, 2) displacement in x and y of the skin that is at each pixel at rest; None: none."""


class Rig(Protocol):
    def presses(self, station: Station, ball_mm: float) -> list[Pressed | ContactError]:
        """The samples of a station, in its order; an error in place of one that friction cannot carry.

        Raises ContactError where the vertical load is already too much.
        """


def rig_of(sensor: Sensor, cache: Path | str, *, progress: bool = True) -> Rig:
    """The gel that the scene asks for; `cache` is where a finite-element compliance is kept."""
    if sensor.elastomer.mechanics == "layer":
        from fastac.sensor.layer_rig import LayerRig

        return LayerRig(sensor)
    from fastac.sensor.fem_rig import FemRig  # scikit-fem is slow to load, and a layer does without

    return FemRig(sensor, cache, progress=progress)
