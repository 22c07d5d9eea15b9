"""Marker dots: detection by threshold and connected components, and tracking from frame to frame.

The paper ("3D Displacement Field Extraction"): sparse marker displacements are extracted by thresholding and
blob detection. Positions are (u, v) in pixels, u along x; index i is the centre of pixel i.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from fastac.models.vision.image_processing import as_channels
from fastac.scenes.sensor_schema import Sensor

NEIGHBOURS = 6
"""Number of neighbouring markers whose median motion predicts a marker's motion."""
MAX_ROUNDS = 5
"""Largest number of rounds of assignment and prediction; two usually suffice."""


class MarkerError(ValueError):
    """Markers that cannot be detected or followed; the message is one line with the values."""


@dataclass(frozen=True)
class Detector:
    """Detects dark dots on a brighter, unevenly lit skin."""

    diameter_px: float
    """Diameter of a dot on the undeformed skin."""
    contrast: float = 0.3
    """Threshold: a pixel belongs to a dot where it is darker than the skin around by more than this share."""
    area_range: tuple[float, float] = (0.25, 2.5)
    """Smallest and largest area of a blob, relative to a dot's area on the undeformed skin."""
    elongation: float = 2.5
    """Largest ratio of the longer to the shorter side of a blob's bounding box."""

    def __post_init__(self):
        if not 2 <= self.diameter_px <= 200:
            raise MarkerError(f"diameter_px = {self.diameter_px:g}: expected 2 to 200")
        if not 0 < self.contrast < 1:
            raise MarkerError(f"contrast = {self.contrast:g}: expected more than 0 and less than 1")

    def detect(self, image: np.ndarray) -> np.ndarray:
        """Centres (K, 2) of the dots of an image (H, W) or (H, W, C) uint8, row by row, float64.

        A colour image is averaged over its channels. A centre is the centroid of a blob's pixels, weighted by
        how much darker than the skin each is. Blobs that touch the image's edge are left out, as their centre
        is unknown. Raises MarkerError on another type or shape.
        """
        if image.dtype != np.uint8 or image.ndim not in (2, 3):
            raise MarkerError(f"image: {image.dtype} {image.shape}: expected uint8 (H, W) or (H, W, C)")
        grey = image.astype(np.float32) if image.ndim == 2 else image.mean(axis=2, dtype=np.float32)
        lacking, dark = self._threshold(grey)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(dark, connectivity=8)
        chosen = self._dots(stats, grey.shape)
        weight = np.bincount(labels.ravel(), lacking.ravel(), count)[chosen]
        v, u = np.indices(grey.shape)
        places = [np.bincount(labels.ravel(), (lacking * at).ravel(), count)[chosen] for at in (u, v)]
        return np.stack(places, axis=-1) / weight[:, None]

    def _threshold(self, grey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How much darker than the skin each pixel is, (H, W) float32 ≥ 0, and the mask of dots, uint8 0 or
        1; see `skin_brightness`.
        """
        skin = skin_brightness(grey, self.diameter_px)
        smooth = cv2.GaussianBlur(grey, (0, 0), max(self.diameter_px / 12, 0.3))
        dark = (smooth < (1 - self.contrast) * skin).astype(np.uint8)
        return np.maximum(skin - smooth, 0), dark

    def _dots(self, stats: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
        """Labels of the blobs that are dots; label 0 is the skin."""
        left, top, width, height, area = stats.T
        dot = np.pi / 4 * self.diameter_px**2
        inside = (left > 0) & (top > 0) & (left + width < shape[1]) & (top + height < shape[0])
        good = inside & (area >= self.area_range[0] * dot) & (area <= self.area_range[1] * dot)
        good &= np.maximum(width, height) <= self.elongation * np.minimum(width, height)
        good[0] = False
        return np.flatnonzero(good)


def skin_brightness(grey: np.ndarray, diameter_px: float) -> np.ndarray:
    """The brightness of the skin without its dots, (H, W) float32, of an image (H, W) float32.

    A morphological closing with a disc wider than a dot removes the dots; a box filter smooths the rest.
    """
    size = int(np.ceil(diameter_px * 1.5)) | 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return cv2.blur(cv2.morphologyEx(grey, cv2.MORPH_CLOSE, disc), (size, size))


def associate(expected_px: np.ndarray, found_px: np.ndarray, max_step_px: float) -> np.ndarray:
    """The index of the found dot (K, 2) for each expected marker (M, 2), −1 for none: (M,) int64.

    The one-to-one assignment with the smallest sum of squared distances is repeated, each time from positions
    predicted by the median motion of each marker's neighbours, until it no longer changes. So a smooth motion
    may exceed half the spacing of the markers; a motion common to all markers may not, for it is ambiguous.
    Pairs farther apart than `max_step_px` from the prediction are not assigned.
    """
    matched = np.full(len(expected_px), -1, np.int64)
    if not len(expected_px) or not len(found_px):
        return matched
    _, near = cKDTree(expected_px).query(expected_px, k=min(NEIGHBOURS + 1, len(expected_px)))
    near = near.reshape(len(expected_px), -1)
    predicted = expected_px
    for _ in range(MAX_ROUNDS):
        square = ((predicted[:, None] - found_px) ** 2).sum(axis=-1)
        rows, columns = linear_sum_assignment(np.minimum(square, max_step_px**2))
        kept = square[rows, columns] <= max_step_px**2
        previous, matched = matched, np.full(len(expected_px), -1, np.int64)
        matched[rows[kept]] = columns[kept]
        if np.array_equal(matched, previous):
            break
        motion = np.where(matched[:, None] >= 0, found_px[matched] - expected_px, np.nan)
        around = motion[near]
        known = np.isfinite(around[..., 0]).sum(axis=1) >= 2
        predicted = expected_px.copy()
        predicted[known] += np.nanmedian(around[known], axis=1)
    return matched


@dataclass(frozen=True, eq=False)
class DetectedDots:
    """The dots of one gel, each frame by itself: a detector, and where the dots are at rest."""

    detector: Detector
    rest_px: np.ndarray
    """(M, 2)"""
    max_step_px: float
    """Largest distance of a dot from where its neighbours' motion predicts it."""

    @classmethod
    def of_background(cls, background: np.ndarray, sensor: Sensor) -> "DetectedDots":
        """Those of a background frame (H, W, C) uint8; raises MarkerError where there are none."""
        if sensor.markers is None:
            raise MarkerError("sensor.markers: missing, so there are no dots to follow")
        rest_px = Detector(2 * sensor.markers.radius_mm / sensor.pitch_mm).detect(background)
        if not len(rest_px):
            raise MarkerError("background: no dot found")
        return cls.at(rest_px, sensor)

    @classmethod
    def at(cls, rest_px: np.ndarray, sensor: Sensor) -> "DetectedDots":
        """Those at known places (M, 2)."""
        dots, pitch_mm = sensor.markers, sensor.pitch_mm
        return cls(Detector(2 * dots.radius_mm / pitch_mm), rest_px, dots.spacing_mm / pitch_mm)

    def shifts_px(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A frame (H, W, C) uint8 to shifts (M, 2) from rest, 0 for lost dots, and which were seen, (M,)."""
        found = self.detector.detect(frame)
        matched = associate(self.rest_px, found, self.max_step_px)
        seen = matched >= 0
        shift = np.zeros_like(self.rest_px)
        shift[seen] = found[matched[seen]] - self.rest_px[seen]
        return shift, seen


@dataclass(frozen=True)
class TrackedMarkers:
    """The markers of a reference frame in another frame."""

    position_px: np.ndarray
    """(M, 2) position of each marker; for a lost one, its last known position."""
    displacement_px: np.ndarray
    """(M, 2) displacement of each marker from the reference; for a lost one, the last known."""
    lost: np.ndarray
    """(M,) bool: markers that were not found in this frame."""
    new_px: np.ndarray
    """(K, 2) positions of detected dots that are no marker of the reference."""


class Tracker:
    """Tracks the markers of a reference frame, (M, 2). Lost ones are searched where they were last found.

    Raises MarkerError on an empty or malformed reference, or a `max_step_px` that is not positive.
    """

    def __init__(self, reference_px: np.ndarray, max_step_px: float):
        reference_px = np.asarray(reference_px, float)
        if reference_px.ndim != 2 or reference_px.shape[1] != 2 or not len(reference_px):
            raise MarkerError(
                f"markers of the reference: {reference_px.shape}: expected (M, 2), M at least 1"
            )
        if not max_step_px > 0:
            raise MarkerError(f"max_step_px = {max_step_px:g}: expected more than 0")
        self.reference_px, self.max_step_px = reference_px, max_step_px
        self.position_px = reference_px.copy()

    def update(self, found_px: np.ndarray) -> TrackedMarkers:
        """The markers in the next frame, from the centres (K, 2) of the dots detected in it.

        Raises MarkerError where not one marker is found.
        """
        matched = associate(self.position_px, found_px, self.max_step_px)
        lost = matched < 0
        if lost.all():
            raise MarkerError(f"markers: all {len(lost)} lost; {len(found_px)} dots found in the frame")
        self.position_px = self.position_px.copy()
        self.position_px[~lost] = found_px[matched[~lost]]
        new = np.setdiff1d(np.arange(len(found_px)), matched)
        return TrackedMarkers(self.position_px, self.position_px - self.reference_px, lost, found_px[new])


@dataclass(frozen=True)
class Markers:
    """The markers of one gel: their positions in the background frame, and detection in other frames."""

    sensor: Sensor
    detector: Detector
    reference_px: np.ndarray
    max_step_px: float

    @classmethod
    def of_background(cls, image: np.ndarray, sensor: Sensor) -> "Markers":
        """The markers in a background frame, channels or RAW10; raises MarkerError where there are none."""
        dots, pitch = sensor.markers, sensor.pitch_mm
        detector = Detector(2 * dots.radius_mm / pitch)
        reference = detector.detect(as_channels(image, sensor))
        step = dots.spacing_mm / pitch
        Tracker(reference, step)
        return cls(sensor, detector, reference, step)

    def find(self, image: np.ndarray) -> TrackedMarkers:
        """Find the markers in a frame, channels or RAW10.

        Frames are independent presses, so markers are searched from their background positions. Raises
        MarkerError where none is found.
        """
        found = self.detector.detect(as_channels(image, self.sensor))
        return Tracker(self.reference_px, self.max_step_px).update(found)
