"""The 3-D displacement field of frames: d_x and d_y from the markers, d_z from the depth.

Source: Lu et al., "FasTac", section "3D Displacement Field Extraction via Depth Reconstruction and Marker
Tracking". Fields cover the N × N inner pixels, the image less its one-pixel boundary, where the solver
computes depth.
"""

from dataclasses import dataclass

import numpy as np

from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.floating.tangential_field import TangentialField
from fastac.models.loops.frames import over_frames, require_frames
from fastac.models.vision.markers import DetectedDots, MarkerError

MAX_LOST = 0.05
"""Largest share of lost markers in a frame whose field is still computed, from the remaining markers."""


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacement fields of a number of frames, without those in which too many markers are lost."""

    field_mm: np.ndarray
    """(kept, 3, N, N) float32: d_x, d_y, and d_z, which is positive where the skin is pressed."""
    kept: np.ndarray
    """(frames,) bool: the frames that `field_mm` holds."""
    lost: np.ndarray
    """(frames,) int64: number of markers that were not found."""


@dataclass(frozen=True, eq=False)
class MarkerField:
    """The markers of one gel in its background frame, and the tangential field of other frames."""

    dots: DetectedDots
    field: TangentialField

    @classmethod
    def of_background(cls, pipeline: FloatPipeline) -> "MarkerField":
        """From the markers in the pipeline's background frame.

        Raises MarkerError where the scene has no markers or too few are found.
        """
        scene = pipeline.scene
        if scene.sensor.markers is None:
            raise MarkerError(f"scene {scene.name}: sensor.markers: missing, so nothing shows d_x, d_y")
        dots = DetectedDots.of_background(pipeline.background, scene.sensor)
        height, width, _ = pipeline.background.shape
        return cls(dots, TangentialField(dots.rest_px, height, width))

    def tangential_px(self, frame: np.ndarray) -> tuple[np.ndarray | None, int]:
        """The tangential field (H, W, 2), in px, of one frame (H, W, C) uint8, and the number of lost
        markers.

        Frames are independent presses, so markers are searched from their background positions. The field is
        None where more than MAX_LOST of the markers are lost.
        """
        shift, seen = self.dots.shifts_px(frame)
        lost = len(seen) - int(seen.sum())
        if lost > MAX_LOST * len(seen):
            return None, lost
        return self.field.for_markers(np.flatnonzero(seen)).dense_px(shift[seen]), lost


def displacement_fields(
    pipeline: FloatPipeline, frames: np.ndarray, *, progress: bool = False
) -> Displacements:
    """The 3-D displacement fields of frames (frames, H, W, C) uint8.

    The scene must have markers and a depth solver. Raises MarkerError where it has no markers, or every frame
    has lost too many.
    """
    require_frames(frames, pipeline.background)
    markers = MarkerField.of_background(pipeline)
    pitch_mm = pipeline.scene.sensor.pitch_mm
    inner = tuple(side - 2 for side in frames.shape[1:3])

    def work(part: np.ndarray, out: dict[str, np.ndarray]) -> None:
        for k, frame in enumerate(part):
            dense_px, out["lost"][k] = markers.tangential_px(frame)
            if dense_px is not None:
                out["tangential_mm"][k] = pitch_mm * dense_px[1:-1, 1:-1].transpose(2, 0, 1)

    outputs = {"tangential_mm": ((2, *inner), np.float32), "lost": ((), np.int64)}
    tangential = over_frames(lambda: work, frames, outputs, progress=progress, label="markers")
    kept = tangential["lost"] <= MAX_LOST * len(markers.field.centre_px)
    if not kept.any():
        raise MarkerError(f"markers: too many lost in each of {len(frames)} frames: at most {MAX_LOST:.0%}")
    normal = pipeline.run(frames[kept], wanted=["displacement_mm"], progress=progress).displacement_mm
    field = np.concatenate([tangential["tangential_mm"][kept], normal[:, None]], axis=1)
    return Displacements(field, kept, tangential["lost"])
