"""Sampling of a camera by a busy pipeline: which frames it accepts, and the spectrum of its outputs."""

from dataclasses import dataclass
from fractions import Fraction
from math import floor

import numpy as np
from scipy.signal.windows import hann

CAMERA_HZ = 240
"""Frame rate of the camera in the paper and in all demonstrations."""


def accepted_frames(camera_hz: Fraction, service_s: Fraction, count: int) -> tuple[list[int], list[Fraction]]:
    """Indices of the frames that a pipeline accepts, and the times in s at which it starts on them.

    Frame k of `count` arrives at k/camera_hz; the pipeline is busy with a frame for `service_s`. When free it
    starts on the newest frame not yet processed, or waits for the next; older ones are dropped. Fractions
    keep the times exact.
    """
    frames, times, free, following = [], [], Fraction(0), 0
    while (frame := max(floor(free * camera_hz), following)) < count:
        start = max(free, frame / camera_hz)
        frames.append(frame)
        times.append(start)
        free, following = start + service_s, frame + 1
    return frames, times


def alias_hz(frequency_hz: float, rate_hz: float) -> float:
    """The alias of a sine sampled evenly at `rate_hz`: its distance from the nearest multiple of the rate."""
    return abs(frequency_hz - rate_hz * round(frequency_hz / rate_hz))


@dataclass(frozen=True)
class Spectrum:
    """One-sided amplitude spectrum of n real samples."""

    frequency_hz: np.ndarray
    """(n // 2 + 1,) frequencies of the bins, from 0."""
    amplitude: np.ndarray
    """(n // 2 + 1,) amplitude of a sine at each bin, in the samples' unit."""

    @property
    def resolution_hz(self) -> float:
        """Distance between two bins."""
        return float(self.frequency_hz[1])

    @property
    def peak_hz(self) -> float:
        """Frequency of the largest bin, zero frequency excluded."""
        return float(self.frequency_hz[1 + self.amplitude[1:].argmax()])


def spectrum(samples: np.ndarray, rate_hz: float) -> Spectrum:
    """Spectrum of samples (n,), treated as evenly spaced, without their mean, under a Hann window.

    Raises ValueError for fewer than 8 samples.
    """
    if len(samples) < 8:
        raise ValueError(f"samples: {len(samples)}: expected 8 or more for a spectrum")
    window = hann(len(samples), sym=False)
    bins = np.fft.rfft((samples - np.mean(samples)) * window)
    return Spectrum(np.fft.rfftfreq(len(samples), 1 / rate_hz), 2 * np.abs(bins) / window.sum())
