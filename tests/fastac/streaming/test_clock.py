"""Time stamps of frames, and the pace of a recording."""

import numpy as np
import pytest

from fastac.streaming import clock

FRAMES = [np.full((1, 1, 1), k, np.uint8) for k in range(4)]


def test_frames_of_a_camera_are_stamped_when_they_arrive():
    times = iter([5, 9, 11, 30])
    found = list(clock.arriving(FRAMES, lambda: next(times)))
    assert [time_ns for time_ns, _ in found] == [5, 9, 11, 30]
    assert [frame.item() for _, frame in found] == [0, 1, 2, 3]


def test_frames_of_a_recording_are_stamped_from_their_number():
    found = clock.recorded(FRAMES, 30, start_ns=10)
    assert [time_ns for time_ns, _ in found] == [10, 33_333_343, 66_666_677, 100_000_010]


def test_a_paced_recording_waits_for_each_frame(monkeypatch):
    """Time passes only while it waits, and while frames are used: the third one takes too long."""
    now, waits = [100.0], []

    def sleep(seconds: float) -> None:
        waits.append(round(seconds, 9))
        now[0] += seconds

    monkeypatch.setattr(clock.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(clock.time, "sleep", sleep)
    for k, _ in enumerate(clock.recorded(FRAMES, 10, paced=True)):
        now[0] += 0.25 if k == 1 else 0.03
    assert waits == [0.07]


@pytest.mark.parametrize("rate", [0, -1, float("inf"), float("nan")])
def test_rates_that_are_none(rate):
    with pytest.raises(ValueError, match=r"frames_per_second = .*: expected a number above 0"):
        next(clock.recorded(FRAMES, rate))
