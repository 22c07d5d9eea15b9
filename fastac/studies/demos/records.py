"""What the demonstrations in time record, frame by frame."""

from dataclasses import dataclass

import numpy as np

from fastac.studies.demos.grip_control import friction_ratio
from fastac.studies.demos.sampling import Spectrum

SLIPPED_MM = 1e-3
"""Sliding beyond this is a slip."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One grasp, frame by frame."""

    time_s: np.ndarray
    true_n: np.ndarray
    """(frames, 3)"""
    found_n: np.ndarray
    """(frames, 3)"""
    tightened_deg: np.ndarray
    hand_n: np.ndarray
    lowered_mm: np.ndarray
    slipped_mm: np.ndarray
    flagged: np.ndarray
    """(frames,) bool: the integers call the frame not to be trusted."""

    def summary(self) -> dict:
        """What a JSON file holds of it."""
        error = np.abs(self.found_n - self.true_n)
        return {
            "slipped": bool(self.slipped_mm[-1] > SLIPPED_MM),
            "slipped_mm": float(self.slipped_mm[-1]),
            "tightened_deg": float(self.tightened_deg[-1]),
            "largest_ratio": {
                "true": float(friction_ratio(self.true_n).max()),
                "found": float(friction_ratio(self.found_n).max()),
            },
            "force_error_n": dict(zip("xyz", error.mean(axis=0).tolist(), strict=True)),
            "flagged_frames": int(self.flagged.sum()),
            "frames": len(self.time_s),
            "series": {
                key: getattr(self, key).tolist() for key in self.__dataclass_fields__ if key != "flagged"
            },
        }


@dataclass(frozen=True, eq=False)
class Recording:
    """One frequency."""

    frequency_hz: int
    camera_s: np.ndarray
    true_n: np.ndarray
    """(frames,) F_z of the contact."""
    found_n: np.ndarray
    """(frames,) F_z of the integers."""
    fine_s: np.ndarray
    fine_n: np.ndarray
    """F_z between frames, from the interpolated load."""


@dataclass(frozen=True, eq=False)
class Seen:
    """One frequency as one pipeline gives it."""

    output_s: np.ndarray
    force_n: np.ndarray
    rate_hz: float
    spectrum: Spectrum
    expected_hz: float
    """The dominant peak of a sine that the same frames sample."""
