"""The interface of the contact models: the pressed skin, and the rigs and probes that press it."""

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
    """The skin pressed by an indenter, at the pixels, and the resultant force."""

    normals: np.ndarray
    """(H, W, 3) float64 outward unit normals."""
    depth_mm: np.ndarray
    """(H, W) float64, height z of the deformed skin."""
    in_contact: np.ndarray
    """(H, W) bool: pixels whose skin touches the indenter; depth and slopes there are the indenter's."""
    force_n: np.ndarray
    """(3,) force of the skin on the indenter along x, y, z; z is positive in compression."""
    pose: dict[str, float]
    """The indenter's pose and size, as a dataset stores them."""
    tangential_mm: np.ndarray | None = None
    """(H, W, 2) displacement along x and y of the skin point that is at each pixel when nothing touches; None
    for a model without tangential displacement."""


class Rig(Protocol):
    """One sensor's gel, on which balls and other objects perform the press protocol."""

    def presses(self, station: Station) -> list[PressedSkin | ContactError]:
        """The samples of a station in its order, with an error in place of one that friction cannot carry.

        Raises ContactError where the contact model cannot carry the vertical load.
        """


class Probe(Protocol):
    """An indenter that stays on the gel while its load changes."""

    def at_load(self, load_n: float) -> PressedSkin:
        """Move the indenter along z until F_z = load_n; the pose has `approach_mm`, measured from first
        touch.

        Raises ContactError for a load that the contact model cannot carry.
        """
