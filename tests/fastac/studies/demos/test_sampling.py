"""Which camera frames a busy pipeline accepts, exactly, and at which frequency a sine then appears."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from fastac.studies.demos.sampling import accepted_frames, alias_hz, spectrum

CAMERA = Fraction(240)


@pytest.mark.parametrize("service", [Fraction(1, 240), Fraction(1, 10**5)])
def test_as_fast_as_the_camera_takes_every_frame_when_it_comes(service):
    frames, times = accepted_frames(CAMERA, service, 240)
    assert frames == list(range(240))
    assert times == [Fraction(k, 240) for k in range(240)]


def test_a_busy_pipeline_takes_the_newest_and_drops_the_others():
    # Free at 0, 10, 20, 30 ms of a camera with a frame every 4 ms.
    frames, times = accepted_frames(Fraction(250), Fraction(1, 100), 9)
    assert frames == [0, 2, 5, 7]
    assert [float(1000 * time) for time in times] == [0, 10, 20, 30]


def test_a_free_pipeline_waits_for_the_next_frame():
    frames, times = accepted_frames(Fraction(250), Fraction(3, 1000), 4)
    assert frames == [0, 1, 2, 3]
    assert [float(1000 * time) for time in times] == [0, 4, 8, 12]
    assert accepted_frames(Fraction(250), Fraction(3, 1000), 0) == ([], [])


@pytest.mark.parametrize("rate", [104, 156])
def test_a_slower_pipeline_keeps_its_rate_and_samples_unevenly(rate):
    frames, times = accepted_frames(CAMERA, Fraction(1, rate), 240)
    assert len(frames) == rate
    assert {later - sooner for sooner, later in pairwise(times)} == {Fraction(1, rate)}
    steps = np.diff(frames)
    assert set(steps) == ({2, 3} if rate == 104 else {1, 2})


@pytest.mark.parametrize(
    ("frequency", "rate", "expected"),
    [
        (50, 104, 50),
        (70, 104, 34),
        (100, 104, 4),
        (70, 156, 70),
        (100, 156, 56),
        (100, 240, 100),
        (250, 100, 50),
    ],
)
def test_alias(frequency, rate, expected):
    assert alias_hz(frequency, rate) == expected


@pytest.mark.parametrize(("frequency", "rate"), [(50, 240), (70, 104), (100, 104), (100, 156)])
def test_a_sine_shows_at_its_alias(frequency, rate):
    samples = 1.0 + 0.4 * np.sin(2 * np.pi * frequency * np.arange(rate) / rate + 0.3)
    found = spectrum(samples, rate)
    assert found.resolution_hz == 1
    assert found.peak_hz == alias_hz(frequency, rate)
    assert found.amplitude[1:].max() == pytest.approx(0.4)
    assert found.amplitude[0] == pytest.approx(0, abs=1e-12)


def test_too_few_samples_for_a_spectrum():
    with pytest.raises(ValueError, match="samples: 7: expected 8"):
        spectrum(np.zeros(7), 100.0)
