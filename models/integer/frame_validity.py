"""Whether a frame can be trusted: what is counted in it, beside the stream, and within which limits.

A sensor that drifts, loses a light, gathers dust or is pressed beyond what its models were trained on gives
depths and forces that look like any other. Counts tell such frames. Their limits follow from the frames
that the models were trained on. Differences are from the background in force, so that one taken anew takes
a drift of the light out of them again.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from fastac.models.integer.words import signed_width

REASONS = (
    "clipped",
    "brightness_b",
    "brightness_g",
    "brightness_r",
    "brightness_nir",
    "change",
    "detail",
    "gradient",
    "displacement",
    "dots",
)
"""Why a frame is suspect, in the order of the bits in the flags and in the hardware's register."""
DISPLACEMENT, DOTS = (1 << REASONS.index(name) for name in ("displacement", "dots"))
OF_FORCE = DISPLACEMENT | DOTS
"""Bits of the reasons that concern the force alone."""
TWO_SIDED = ("brightness_b", "brightness_g", "brightness_r", "brightness_nir", "detail")
"""Measures that may also be too small."""
RANGE_DIVISOR = 2
SHARE_DIVISOR = 1000
RELATIVE_DIVISOR = 20
"""The margin beyond the range that was seen: a half of it, and at least a thousandth of all values that can
be counted, one digital number a pixel of brightness, a twentieth of the largest change and detail."""


@dataclass(frozen=True, eq=False)
class FrameValidity:
    """What is counted in each frame, `names`, and the limits beyond which a frame is suspect.

    clipped : pixels with a channel at 0 or 255: dead and overexposed ones
    brightness_b, _g, _r, _nir : Σ ΔI of a channel, ΔI = pixel − background: gain, offset, a light that fails
    change : Σ |ΔI| over all channels: contacts larger than those that were trained on
    detail : Σ |I[v, u] − I[v, u − 1]| over all channels: the skin's texture, lost out of focus
    gradient : slopes that saturated. Only with `slopes`.
    displacement : displacements that saturated. Only with `displacements`.
    dots : marker dots that are lost: covered, smeared or doubled. Only where `dots`, their number, is not 0.

    A measure below its `low` or above its `high` sets the bit of its name in REASONS.
    """

    shape: tuple[int, int, int]  # H, W, C
    slopes: bool
    displacements: bool
    low: np.ndarray  # (measures,)
    high: np.ndarray  # (measures,)
    dots: int = 0

    def __post_init__(self):
        if len(self.shape) != 3:
            raise ValueError(f"shape {self.shape}: expected (H, W, C)")
        for name, values in (("low", self.low), ("high", self.high)):
            if np.shape(values) != (len(self.names),):
                raise ValueError(f"{name} {np.shape(values)}: expected ({len(self.names)},)")
            for measure, value, least, most in zip(self.names, values, *self.bounds, strict=True):
                if not least <= value <= most:
                    raise ValueError(f"{name} of {measure} {value}: expected {least} to {most}")

    @classmethod
    def unlimited(
        cls, shape: tuple[int, int, int], *, slopes: bool, displacements: bool, dots: int = 0
    ) -> "FrameValidity":
        """The measures of frames (H, W, C) with limits that no frame exceeds."""
        return cls(shape, slopes, displacements, *_bounds(shape, slopes, displacements, dots), dots)

    @property
    def names(self) -> tuple[str, ...]:
        return _names(self.shape[2], self.slopes, self.displacements, self.dots)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest value of each measure, of any frame."""
        return _bounds(self.shape, self.slopes, self.displacements, self.dots)

    @property
    def widths(self) -> tuple[int, ...]:
        """Bits of each measure and of its limits, with a sign."""
        return tuple(signed_width(int(most)) for most in self.bounds[1])

    def of_pixels(self, frame: np.ndarray, background: np.ndarray) -> np.ndarray:
        """A frame and the background (H, W, C) uint8 to the measures of the pixels, int64."""
        height, width, channels = frame.shape
        within = cv2.inRange(frame, (1,) * channels, (254,) * channels)
        brightness = np.subtract(cv2.sumElems(frame), cv2.sumElems(background))
        return np.array(
            [
                height * width - cv2.countNonZero(within),
                *brightness[:channels],
                cv2.norm(frame, background, cv2.NORM_L1),
                cv2.norm(frame[:, 1:], frame[:, :-1], cv2.NORM_L1),
            ],
            np.int64,
        )

    def flags(self, measures: np.ndarray) -> np.ndarray:
        """Measures (..., measures) to flags (...), a bit for each of REASONS; 0: nothing is suspect."""
        weights = [1 << REASONS.index(name) for name in self.names]
        return ((measures < self.low) | (measures > self.high)) @ np.array(weights)

    def limited(self, measures: np.ndarray) -> "FrameValidity":
        """The same with limits around the measures (frames, measures) of good frames.

        An untouched frame is good, so 0 is within the limits of all but the detail; see RANGE_DIVISOR and
        the constants below it for the margin.
        """
        height, width, _ = self.shape
        least, most = self.bounds
        low, high = [], []
        for name, values, floor, ceiling in zip(self.names, measures.T, least, most, strict=True):
            smallest, largest = int(values.min()), int(values.max())
            if name.startswith("brightness"):
                smallest, largest, margin = min(smallest, 0), max(largest, 0), height * width
            elif name in ("change", "detail"):
                margin = largest // RELATIVE_DIVISOR
            else:
                margin = int(ceiling) // SHARE_DIVISOR
            if name not in TWO_SIDED:
                smallest = 0
            margin = max(margin, (largest - int(values.min())) // RANGE_DIVISOR)
            low.append(max(smallest - margin, int(floor)))
            high.append(min(largest + margin, int(ceiling)))
        return replace(self, low=np.array(low), high=np.array(high))


def suspects(flags: np.ndarray) -> np.ndarray:
    """Whether flags (...) are of a frame whose depth is not to be trusted."""
    return (flags & ~OF_FORCE) != 0


def _names(channels: int, slopes: bool, displacements: bool, dots: int) -> tuple[str, ...]:
    brightness = REASONS[1 : 1 + channels]
    absent = {"gradient": not slopes, "displacement": not displacements, "dots": not dots}
    return ("clipped", *brightness, *(name for name in REASONS[5:] if not absent.get(name)))


def _bounds(
    shape: tuple[int, int, int], slopes: bool, displacements: bool, dots: int
) -> tuple[np.ndarray, np.ndarray]:
    height, width, channels = shape
    largest = {
        "clipped": height * width,
        "change": 255 * height * width * channels,
        "detail": 255 * height * (width - 1) * channels,
        "gradient": 2 * height * width,
        "displacement": (height - 2) * (width - 2),
        "dots": dots,
    }
    names = _names(channels, slopes, displacements, dots)
    high = np.array([largest.get(name, 255 * height * width) for name in names])
    return np.where([name.startswith("brightness") for name in names], -high, 0), high
