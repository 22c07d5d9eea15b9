"""Grip control: close the fingers where μ = F_s/F_n is too large, as in the paper, or on incipient slip."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Rule = Callable[[np.ndarray, float | None], bool]
"""Of the force (3,) in N that is found in a frame, and its spread in px if that is flagged, else None:
whether the fingers are to close by a step."""


def friction_ratio(force_n: np.ndarray) -> np.ndarray:
    """μ = F_s/F_n (…) of forces (…, 3) in N: shear over normal force; infinite without normal force."""
    shear, normal = np.hypot(force_n[..., 0], force_n[..., 1]), force_n[..., 2]
    return np.where(normal > 0, shear / np.where(normal > 0, normal, 1.0), np.inf)


def without_feedback(force_n: np.ndarray, slip_px: float | None) -> bool:
    """The fingers never close."""
    return False


@dataclass
class SlipFeedback:
    """The fingers close where a frame is flagged as slipping, whatever the force and μ, and its spread is
    larger than ever before: skin that slid stays where it slid to, so that a spread stays, too."""

    largest_px: float = 0.0
    """The largest spread so far."""

    def __call__(self, force_n: np.ndarray, slip_px: float | None) -> bool:
        if slip_px is None or slip_px <= self.largest_px:
            return False
        self.largest_px = slip_px
        return True


@dataclass(frozen=True)
class FrictionFeedback:
    """The fingers close where μ > μ_s + d."""

    stable_ratio: float
    """μ_s, the ratio regarded as stable."""
    margin: float
    """d, how far μ may exceed μ_s."""

    @property
    def limit(self) -> float:
        """μ_s + d, above which the fingers close."""
        return self.stable_ratio + self.margin

    def __call__(self, force_n: np.ndarray, slip_px: float | None) -> bool:
        return bool(friction_ratio(force_n) > self.limit)


@dataclass
class GripControl:
    """Closes the fingers by one step for every frame in which its rule says so."""

    rule: Rule
    step_deg: float
    """Decrease of the angle between the fingers per step."""
    most_deg: float
    """Largest decrease of that angle in all."""
    delay_frames: int = 1
    """Frames from the one that is evaluated to the first one that sees the motors' response."""

    def __post_init__(self):
        self.tightened_deg = 0.0
        """Commanded decrease of the angle between the fingers since the start."""
        self._pending_deg = [0.0] * (self.delay_frames - 1)

    def __call__(self, force_n: np.ndarray, slip_px: float | None) -> float:
        """Take what a rule takes of this frame; return the decrease in degrees that the next frame sees."""
        if self.rule(force_n, slip_px):
            self.tightened_deg = min(self.tightened_deg + self.step_deg, self.most_deg)
        self._pending_deg.append(self.tightened_deg)
        return self._pending_deg.pop(0)
