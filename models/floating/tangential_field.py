"""Dense tangential displacement from marker displacements, by radial basis functions.

The paper (Lu et al., "FasTac", "3D Displacement Field Extraction"): u_tan(p) = Σ w_k φ(|p − c_k|) with the
inverse multiquadric φ(r) = 1 / √(r² + ε²), where the weights w_k interpolate the markers' displacements, and
the normal displacement d_z = D_0 − D_t, the background's depth less the frame's.
"""

from functools import lru_cache

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from fastac.models.vision.markers import MarkerError, TrackedMarkers

MIN_MARKERS = 3
"""Smallest number of markers: three determine an affine motion of the plane."""
MIN_SPACING = 1e-2
"""Smallest distance of two markers, in units of ε: closer ones make the equations nearly singular."""


class TangentialField:
    """Interpolation from one set of markers to every pixel, by a matrix that is computed once.

    centre_px : (M, 2) positions (u, v) of the markers in the background frame
    epsilon_px : the kernel's shape parameter ε; by default the median distance of neighbouring markers

    Exact at the markers; far from all of them the field decays to zero, as the paper's kernel does. Raises
    MarkerError on fewer than three markers, two at the same position, or a value that is not finite.
    """

    def __init__(self, centre_px: np.ndarray, height_px: int, width_px: int, epsilon_px: float | None = None):
        centre_px = np.asarray(centre_px, float)
        if centre_px.ndim != 2 or centre_px.shape[-1] != 2 or len(centre_px) < MIN_MARKERS:
            raise MarkerError(
                f"markers: {len(centre_px)} given: the displacement field needs at least {MIN_MARKERS},"
                " (M, 2)"
            )
        if not np.isfinite(centre_px).all():
            raise MarkerError("markers: a position is not finite")
        nearest = cKDTree(centre_px).query(centre_px, k=2)[0][:, 1]
        epsilon = float(np.median(nearest)) if epsilon_px is None else epsilon_px
        if not epsilon > 0 or nearest.min() < MIN_SPACING * epsilon:
            u, v = centre_px[nearest.argmin()]
            raise MarkerError(f"markers: two are {nearest.min():.3g} px apart at u = {u:.1f}, v = {v:.1f}")
        self.centre_px, self.epsilon_px = centre_px, epsilon
        self.height_px, self.width_px = height_px, width_px
        v, u = np.indices((height_px, width_px)).reshape(2, -1)
        among = cho_factor(self._kernel(centre_px))
        self.matrix = cho_solve(among, self._kernel(np.stack([u, v], axis=-1)).T).T
        """(H·W, M): maps marker displacements to pixel displacements."""
        self._of_subset = lru_cache(maxsize=8)(self._subset)

    def _kernel(self, points_px: np.ndarray) -> np.ndarray:
        return 1 / np.sqrt(cdist(points_px, self.centre_px, "sqeuclidean") + self.epsilon_px**2)

    def _subset(self, kept: tuple[int, ...]) -> "TangentialField":
        return TangentialField(self.centre_px[list(kept)], self.height_px, self.width_px, self.epsilon_px)

    def dense_px(self, displacement_px: np.ndarray) -> np.ndarray:
        """Displacement of every pixel, (…, H, W, 2) float64, from marker displacements (…, M, 2), in px."""
        if displacement_px.shape[-2:] != self.centre_px.shape:
            raise MarkerError(
                f"marker displacements: {displacement_px.shape}: expected (…, {len(self.centre_px)}, 2)"
            )
        dense = self.matrix @ displacement_px
        return dense.reshape(*displacement_px.shape[:-2], self.height_px, self.width_px, 2)

    def tracked_px(self, tracked: TrackedMarkers) -> np.ndarray:
        """The field (H, W, 2) of one frame, in px, from the markers found in it.

        Where markers are lost, the remaining ones are interpolated. Raises MarkerError where fewer than three
        remain.
        """
        kept = np.flatnonzero(~tracked.lost)
        if len(kept) < MIN_MARKERS:
            raise MarkerError(
                f"markers: {len(kept)} of {len(tracked.lost)} left: the displacement field needs"
                f" {MIN_MARKERS}"
            )
        return self.for_markers(kept).dense_px(tracked.displacement_px[kept])

    def for_markers(self, kept: np.ndarray) -> "TangentialField":
        """The field of the markers with the indices `kept` alone; the last eight such fields are cached."""
        return self if len(kept) == len(self.centre_px) else self._of_subset(tuple(kept.tolist()))


def displacement_mm(
    tangential_px: np.ndarray, background_depth_mm: np.ndarray, depth_mm: np.ndarray, pitch_mm: float
) -> np.ndarray:
    """Displacement d_x, d_y, d_z of every pixel, (…, H, W, 3) in mm.

    tangential_px : (…, H, W, 2); depths : (…, H, W) in mm
    d_z is the background's depth less the frame's: positive where the skin is pressed. Raises MarkerError on
    shapes that do not fit.
    """
    normal = background_depth_mm - depth_mm
    if tangential_px.shape != (*normal.shape, 2):
        raise MarkerError(
            f"displacement: {tangential_px.shape} tangential, depths {normal.shape}: expected (…, H, W, 2)"
        )
    return np.concatenate([tangential_px * pitch_mm, normal[..., None]], axis=-1)
