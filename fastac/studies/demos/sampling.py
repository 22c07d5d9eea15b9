"""Which frames a pipeline takes from a camera, and which frequency its outputs then show."""

from dataclasses import dataclass
from fractions import Fraction
from math import floor

import numpy as np
from scipy.signal.windows import hann

CAMERA_HZ = 240


def taken(camera_hz: Fraction, service_s: Fraction, count: int) -> tuple[list[int], list[Fraction]]:
    """The frames, of `count` that arrive at k/camera_hz, that a pipeline takes, and when, in s.

    It is busy with a frame for `service_s`. Whenever it is free it takes the newest frame that it has not
    had, or waits for the next; older ones are dropped. Times are exact.
    """
    frames, times, free, following = [], [], Fraction(0), 0
    while (frame := max(floor(free * camera_hz), following)) < count:
        start = max(free, frame / camera_hz)
        frames.append(frame)
        times.append(start)
        free, following = start + service_s, frame + 1
    return frames, times


def alias_hz(frequency_hz: float, rate_hz: float) -> float:
    """Where a sine shows in samples at `rate_hz`: its distance from the nearest multiple of the rate."""
    return abs(frequency_hz - rate_hz * round(frequency_hz / rate_hz))


@dataclass(frozen=True)
class Spectrum:
    frequency_hz: np.ndarray
    """(n // 2 + 1,) of the bins, from 0."""
    amplitude: np.ndarray
    """(n // 2 + 1,) of the sine that would give each bin, in the samples' unit."""

    @property
    def resolution_hz(self) -> float:
        """From one bin to the next."""
        return float(self.frequency_hz[1])

    @property
    def peak_hz(self) -> float:
        """The dominant bin but that of zero frequency."""
        return float(self.frequency_hz[1 + self.amplitude[1:].argmax()])


def spectrum(samples: np.ndarray, rate_hz: float) -> Spectrum:
    """The DFT of (n,) samples taken as even, their mean removed, under a Hann window.

    Raises ValueError for fewer than 8 samples.
    """
    if len(samples) < 8:
        raise ValueError(f"samples: {len(samples)}: expected 8 or more for a spectrum")
    window = hann(len(samples), sym=False)
    bins = np.fft.rfft((samples - np.mean(samples)) * window)
    return Spectrum(np.fft.rfftfreq(len(samples), 1 / rate_hz), 2 * np.abs(bins) / window.sum())
