"""Ground-truth normals and depth rendered from a ball's pose and the sensor's CAD, as in the paper.

Where the skin touches the ball its depth and normals are the ball's. The region where the ball is below the
undeformed skin is larger than the contact, for the skin around the contact sinks too. On an elastic
half-space the contact ends where the ball's depth below the undeformed skin is half of its maximum (Hertz);
on a layer, which yields less around the contact, farther out. So where the depth exceeds a larger share of
the maximum, CONTACT_SHARE, contact is certain; only there the labels are valid.
"""

import numpy as np

from fastac.sensor.geometry import ball_slopes, normals_from_slopes, pixel_centres_mm
from fastac.sensor.importers.cad import Cad, half_extent_mm
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.poses import Pose
from fastac.sensor.mechanics.indenter import Ball

CONTACT_SHARE = 0.6
"""Share of the ball's largest depth below the undeformed skin beyond which contact is certain: one half, and
a fifth more for friction and tilt."""


def labels(cad: Cad, pose: Pose, ball_mm: float, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals (H, W, 3), depth_mm (H, W), both NaN where not valid, and valid (H, W) bool.

    No pixel is valid under tangential load: the paper, too, takes geometry from vertical presses only. Raises
    ImportFailure, beginning with `where`, for a pose beside the skin, above it, or deeper than the elastomer
    is thick.
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
    """Raise ImportFailure for a pose that is physically impossible; see `labels`."""
    half = half_extent_mm(cad.sensor)
    for key, value, limit in (("x_mm", pose.x_mm, half[0]), ("y_mm", pose.y_mm, half[1])):
        if abs(value) > limit:
            raise ImportFailure(f"{where}: {key} = {value:g}: outside the skin, ±{limit:g} mm")
    sunk = cad.first_touch_mm(ball_mm, pose.x_mm, pose.y_mm) - pose.z_mm
    thickness = cad.sensor.elastomer.thickness_mm
    if sunk <= 0 and pose.is_vertical:  # a tangential load moves the skin, on a slope even below the ball
        raise ImportFailure(f"{where}: z_mm = {pose.z_mm:g}: the ball is {-sunk:.3g} mm above the skin")
    if sunk > thickness:
        raise ImportFailure(
            f"{where}: z_mm = {pose.z_mm:g}: sinks {sunk:.3g} mm into {thickness:g} mm of elastomer"
        )
