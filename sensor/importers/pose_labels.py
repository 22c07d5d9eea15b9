"""Ground truth from a pose, the ball and the sensor's CAD, as the paper renders it.

Where the skin lies against the ball its depth and normals are the ball's. How far that goes the pose does not
say: the ball below the resting skin is too much, for the gel around it gives way too. On a half-space the
contact ends where the ball is half as deep below the resting skin as at its deepest (Hertz), and on a layer,
which gives way less, farther out. So what is deeper than a larger share than that is certain to touch.
"""

import numpy as np

from fastac.sensor.geometry import ball_slopes, normals_from_slopes, pixel_centres_mm
from fastac.sensor.importers.cad import Cad, half_extent_mm
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.poses import Pose
from fastac.sensor.mechanics.indenter import Ball

CONTACT_SHARE = 0.6
"""Of the deepest point's depth below the resting skin: half, and a fifth more for friction and tilt."""


def labels(cad: Cad, pose: Pose, ball_mm: float, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals (H, W, 3), depth_mm (H, W), both NaN where not valid, and valid (H, W) bool.

    Nothing is valid under a ball that was dragged: the paper, too, takes geometry from vertical samples only.
    Raises ImportFailure, beginning with `where`, for a pose beside the skin, above it, or deeper than the
    elastomer is thick.
    """
    check(cad, pose, ball_mm, where)
    x, y = pixel_centres_mm(cad.sensor)
    x, y = x - pose.x_mm, y - pose.y_mm
    surface = Ball(ball_mm).surface(x, y)[0] + pose.z_mm
    below = cad.rest_depth_mm - surface
    valid = (below > CONTACT_SHARE * below.max()) & pose.is_vertical
    normals, depth = np.full((*x.shape, 3), np.nan), np.full(x.shape, np.nan)
    normals[valid] = normals_from_slopes(*ball_slopes(x[valid], y[valid], ball_mm))
    depth[valid] = surface[valid]
    return normals, depth, valid


def check(cad: Cad, pose: Pose, ball_mm: float, where: str) -> None:
    """Raise ImportFailure where no gel could be pressed so."""
    half = half_extent_mm(cad.sensor)
    for key, value, limit in (("x_mm", pose.x_mm, half[0]), ("y_mm", pose.y_mm, half[1])):
        if abs(value) > limit:
            raise ImportFailure(f"{where}: {key} = {value:g}: outside the skin, ±{limit:g} mm")
    sunk = cad.first_touch_mm(ball_mm, pose.x_mm, pose.y_mm) - pose.z_mm
    thickness = cad.sensor.elastomer.thickness_mm
    if sunk <= 0 and pose.is_vertical:  # a dragged one has taken the skin along, perhaps downhill
        raise ImportFailure(f"{where}: z_mm = {pose.z_mm:g}: the ball is {-sunk:.3g} mm above the skin")
    if sunk > thickness:
        raise ImportFailure(
            f"{where}: z_mm = {pose.z_mm:g}: sinks {sunk:.3g} mm into {thickness:g} mm of elastomer"
        )
