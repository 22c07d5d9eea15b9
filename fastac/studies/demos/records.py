"""Time series of the demonstrations: a grasp frame by frame, and a vibration as recorded and as output."""

from dataclasses import dataclass

import numpy as np

from fastac.studies.demos.grip_control import friction_ratio
from fastac.studies.demos.sampling import Spectrum

SLIP_THRESHOLD_MM = 1e-3
"""A bottle that has slid further than this counts as slipped."""


@dataclass(frozen=True, eq=False)
class SlipTrace:
    """What one grasp shows of slip: arrays of one entry per camera frame."""

    slip_px: np.ndarray
    """Spread of the dots in contact, by the integer model."""
    slip_dots: np.ndarray
    """Dots in contact, by the integer model."""
    slipping: np.ndarray
    """bool: the spread is beyond the scene's limit."""
    sticking: np.ndarray
    """Share of the nodes in contact that stick, by the contact mechanics."""


@dataclass(frozen=True, eq=False)
class GraspTrace:
    """One grasp: arrays of one entry per camera frame."""

    time_s: np.ndarray
    true_force_n: np.ndarray
    """(frames, 3) of one finger, by the contact mechanics."""
    found_force_n: np.ndarray
    """(frames, 3) of one finger, by the integer model from the frame."""
    tightened_deg: np.ndarray
    """Decrease of the angle between the fingers since the start."""
    hand_n: np.ndarray
    """Force of the hand on the bottle's cap."""
    lowered_mm: np.ndarray
    """Displacement of the bottle since the start: the skin's shear and slip together."""
    slipped_mm: np.ndarray
    """Slip alone, accumulated since the start."""
    flagged: np.ndarray
    """(frames,) bool: the integer model's validity flags mark the frame as suspect."""
    slip: SlipTrace | None = None
    """Where the scene has the output slip."""

    def summary(self) -> dict:
        """Slip, errors and time series as JSON content."""
        error = np.abs(self.found_force_n - self.true_force_n)
        content = {
            "slipped": bool(self.slipped_mm[-1] > SLIP_THRESHOLD_MM),
            "slipped_mm": float(self.slipped_mm[-1]),
            "tightened_deg": float(self.tightened_deg[-1]),
            "largest_ratio": {
                "true": float(friction_ratio(self.true_force_n).max()),
                "found": float(friction_ratio(self.found_force_n).max()),
            },
            "force_error_n": dict(zip("xyz", error.mean(axis=0).tolist(), strict=True)),
            "flagged_frames": int(self.flagged.sum()),
            "frames": len(self.time_s),
            "series": {
                "time_s": self.time_s.tolist(),
                "true_n": self.true_force_n.tolist(),
                "found_n": self.found_force_n.tolist(),
                "tightened_deg": self.tightened_deg.tolist(),
                "hand_n": self.hand_n.tolist(),
                "lowered_mm": self.lowered_mm.tolist(),
                "slipped_mm": self.slipped_mm.tolist(),
            },
        }
        if self.slip is not None:
            content |= self._flags(self.slip)
            content["series"] |= {name: values.tolist() for name, values in vars(self.slip).items()}
        return content

    def _flags(self, slip: SlipTrace) -> dict:
        """How many frames are flagged as slipping, and the state of the contact in the first of them."""
        first = int(slip.slipping.argmax())
        state = {
            "time_s": float(self.time_s[first]),
            "sticking": float(slip.sticking[first]),
            "true_ratio": float(friction_ratio(self.true_force_n[first])),
            "slipped_mm": float(self.slipped_mm[first]),
        }
        count = int(slip.slipping.sum())
        return {"slipping_frames": count, "first_slipping": state if count else None}


@dataclass(frozen=True, eq=False)
class VibrationRecording:
    """All camera frames of one vibration frequency, and the force in each."""

    frequency_hz: int
    camera_s: np.ndarray
    """(frames,) time of each frame."""
    true_force_n: np.ndarray
    """(frames,) F_z by the contact mechanics."""
    found_force_n: np.ndarray
    """(frames,) F_z by the integer model."""
    fine_s: np.ndarray
    """(n,) times between the frames, for plotting."""
    fine_force_n: np.ndarray
    """(n,) true F_z at `fine_s`, from the interpolated load."""


@dataclass(frozen=True, eq=False)
class PipelineOutput:
    """The forces that one pipeline outputs for one vibration: those of the frames that it accepts."""

    output_s: np.ndarray
    """(outputs,) time of each output."""
    force_n: np.ndarray
    """(outputs,) F_z."""
    rate_hz: float
    """Mean output rate."""
    spectrum: Spectrum
    expected_hz: float
    """Dominant frequency of an ideal sine sampled at the same frames."""
