"""Grip control by friction feedback, as in the paper: close the fingers where μ = F_s/F_n is too large."""

from dataclasses import dataclass

import numpy as np


def friction_ratio(force_n: np.ndarray) -> np.ndarray:
    """μ = F_s/F_n (…) of forces (…, 3) in N: shear over normal force; infinite without normal force."""
    shear, normal = np.hypot(force_n[..., 0], force_n[..., 1]), force_n[..., 2]
    return np.where(normal > 0, shear / np.where(normal > 0, normal, 1.0), np.inf)


@dataclass
class GripControl:
    """Closes the fingers by one step for every frame whose force has μ > μ_s + d."""

    stable_ratio: float
    """μ_s, the ratio regarded as stable; infinite switches the feedback off."""
    margin: float
    """d, how far μ may exceed μ_s."""
    step_deg: float
    """Decrease of the angle between the fingers per step."""
    most_deg: float
    """Largest decrease of that angle in all."""
    delay_frames: int = 1
    """Frames from the one whose force is evaluated to the first one that sees the motors' response."""

    def __post_init__(self):
        self.tightened_deg = 0.0
        """Commanded decrease of the angle between the fingers since the start."""
        self._pending_deg = [0.0] * (self.delay_frames - 1)

    @property
    def limit(self) -> float:
        """μ_s + d, above which the fingers close."""
        return self.stable_ratio + self.margin

    def __call__(self, force_n: np.ndarray) -> float:
        """Take the force (3,) in N of this frame; return the decrease in degrees that the next frame sees."""
        if friction_ratio(force_n) > self.limit:
            self.tightened_deg = min(self.tightened_deg + self.step_deg, self.most_deg)
        self._pending_deg.append(self.tightened_deg)
        return self._pending_deg.pop(0)
