"""What any pipeline finds in frames: normals, slopes, depth, displacement, force."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Result:
    """What a pipeline finds in frames; what the scene, or the caller, does not want is None.

    normals (frames, H, W, 3) unit; slopes (frames, H, W, 2); depth_mm (frames, H, W), the prior on the
    boundary; displacement_mm (frames, N, N) towards the camera, positive in contact; force_n (frames, axes)
    and force_map_n (frames, axes, N, N), of the scene's axes.
    Integer pipelines add raw words: depth_words (frames, N, N), force_raw (frames, axes), force_map_raw
    (frames, axes, N, N), normal_words (frames, H, W, 3), how many values saturated in each frame, and whether
    it can be trusted: validity_measures (frames, measures) and the flags validity (frames,), see
    `validity.FrameValidity`.
    """

    normals: np.ndarray | None = None
    slopes: np.ndarray | None = None
    depth_mm: np.ndarray | None = None
    displacement_mm: np.ndarray | None = None
    force_n: np.ndarray | None = None
    force_map_n: np.ndarray | None = None
    normal_words: np.ndarray | None = None
    depth_words: np.ndarray | None = None
    displacement_words: np.ndarray | None = None
    force_raw: np.ndarray | None = None
    force_map_raw: np.ndarray | None = None
    gradient_saturated: np.ndarray | None = None
    displacement_saturated: np.ndarray | None = None
    validity_measures: np.ndarray | None = None
    validity: np.ndarray | None = None


def concatenate(results: list[Result]) -> Result:
    """Results of consecutive frames as one."""
    return Result(
        **{
            name: None
            if getattr(results[0], name) is None
            else np.concatenate([getattr(r, name) for r in results])
            for name in Result.__dataclass_fields__
        }
    )
