"""The result of a pipeline, float or integer: normals, slopes, depth, displacement and force of frames."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Result:
    """The outputs of a pipeline for a number of frames; None where neither scene nor caller wants the output.

    N = H − 2: the solver works on the inner pixels, the image less its one-pixel boundary.

    normals : (frames, H, W, 3) unit vectors
    slopes : (frames, H, W, 2), p = ∂z/∂x and q = ∂z/∂y
    depth_mm : (frames, H, W), on the boundary the undeformed skin's depth
    displacement_mm : (frames, N, N) along −z, towards the camera: positive in contact
    force_n : (frames, axes), and force_map_n : (frames, axes, N, N), for the scene's force axes
    force_half_width_n : (frames, axes), the interval around each force is force_n ± this; integer pipelines
        alone
    dot_shifts_px : (frames, M, 2) along u and v, of the marker dots from their places at rest; 0: lost
    dots_seen : (frames, M) bool
    slip_px : (frames,) root mean square spread of the shifts of the dots in contact about the rigid motion
        that fits them; 0 for fewer than three dots
    slip_dots, slipping : (frames,) how many dots are in contact, and (frames,) bool, whether their spread is
        beyond the scene's limit

    Integer pipelines add the raw words: normal_words (frames, H, W, 3), depth_words and displacement_words
    (frames, N, N), dot_shift_words (frames, M, 2), slip_words (frames,), force_raw and force_half_width_raw
    (frames, axes) and force_map_raw (frames, axes, N, N); how many values saturated in each frame,
    gradient_saturated and displacement_saturated (frames,); and whether a frame can be trusted,
    validity_measures (frames, measures) and the flags validity (frames,), see `frame_validity.FrameValidity`.
    """

    normals: np.ndarray | None = None
    slopes: np.ndarray | None = None
    depth_mm: np.ndarray | None = None
    displacement_mm: np.ndarray | None = None
    force_n: np.ndarray | None = None
    force_map_n: np.ndarray | None = None
    force_half_width_n: np.ndarray | None = None
    dot_shifts_px: np.ndarray | None = None
    dots_seen: np.ndarray | None = None
    slip_px: np.ndarray | None = None
    slip_dots: np.ndarray | None = None
    slipping: np.ndarray | None = None
    normal_words: np.ndarray | None = None
    depth_words: np.ndarray | None = None
    displacement_words: np.ndarray | None = None
    dot_shift_words: np.ndarray | None = None
    slip_words: np.ndarray | None = None
    force_raw: np.ndarray | None = None
    force_map_raw: np.ndarray | None = None
    force_half_width_raw: np.ndarray | None = None
    gradient_saturated: np.ndarray | None = None
    displacement_saturated: np.ndarray | None = None
    validity_measures: np.ndarray | None = None
    validity: np.ndarray | None = None


def concatenate(results: list[Result]) -> Result:
    """Join the results of consecutive frames along the frame axis; all have the same fields."""
    return Result(
        **{
            name: None
            if getattr(results[0], name) is None
            else np.concatenate([getattr(r, name) for r in results])
            for name in Result.__dataclass_fields__
        }
    )
