"""A press on either kind of gel: what it makes of the skin, and the force."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fastac.sensor.protocol import Station


class FemError(ValueError):
    """A gel that the finite elements cannot represent; the message is one line with the values."""


class ContactError(ValueError):
    """A contact that the model cannot represent; the message is one line with the values."""


@dataclass(frozen=True)
class PressedSkin:
    """The skin under a ball."""

    normals: np.ndarray
    """(H, W, 3) float64 outward unit normals."""
    depth_mm: np.ndarray
    """(H, W) float64, z."""
    in_contact: np.ndarray
    """(H, W) bool: the skin lies against the ball, and its slopes are the ball's."""
    force_n: np.ndarray
    """(3,) the skin's force on the ball, z positive in compression."""
    pose: dict[str, float]
    """What a dataset keeps of the indenter."""
    tangential_mm: np.ndarray | None = None
    """(H, W, 2) displacement in x and y of the skin that is at each pixel at rest; None: none."""


class Rig(Protocol):
    def presses(self, station: Station, ball_mm: float) -> list[PressedSkin | ContactError]:
        """The samples of a station, in its order; an error in place of one that friction cannot carry.

        Raises ContactError where the vertical load is already too much.
        """


class Probe(Protocol):
    def at_load(self, load_n: float) -> PressedSkin:
        """The next state: led along z until F_z = load_n; the pose has `approach_mm`, from first touch.

        Raises ContactError for a load that cannot be carried.
        """
