"""The friction feedback of a grasp: μ = F_s/F_n of the forces found, and the angle between the fingers."""

from dataclasses import dataclass

import numpy as np


def friction_ratio(force_n: np.ndarray) -> np.ndarray:
    """μ = F_s/F_n, (…), of forces (…, 3) in N; infinite where nothing presses."""
    shear, normal = np.hypot(force_n[..., 0], force_n[..., 1]), force_n[..., 2]
    return np.where(normal > 0, shear / np.where(normal > 0, normal, 1.0), np.inf)


@dataclass
class GripControl:
    """Tightens by a step for every force with μ > μ_s + d."""

    stable_ratio: float
    """μ_s; infinite: no feedback."""
    margin: float
    """d"""
    step_deg: float
    most_deg: float
    """The fingers close no further than this."""
    delay_frames: int = 1
    """From the frame that is answered to the first one that shows the answer."""

    def __post_init__(self):
        self.tightened_deg = 0.0
        """By how much the angle between the fingers is smaller than at first, as the motors were told."""
        self._under_way = [0.0] * (self.delay_frames - 1)

    @property
    def limit(self) -> float:
        return self.stable_ratio + self.margin

    def __call__(self, force_n: np.ndarray) -> float:
        """The force (3,) found in this frame; returns what the motors have done by the next, in degrees."""
        if friction_ratio(force_n) > self.limit:
            self.tightened_deg = min(self.tightened_deg + self.step_deg, self.most_deg)
        self._under_way.append(self.tightened_deg)
        return self._under_way.pop(0)
