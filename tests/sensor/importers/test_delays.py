"""Delays between frames and forces are found where they are, and nowhere else."""

import numpy as np
import pytest

from fastac.sensor.importers.delays import MOST_FRAMES, SHORTEST, delay, delays


def pressed(late: int, count: int = 90, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """What the frames and the forces of two squeezes show; the frames come `late` frames after the forces."""
    rng = np.random.default_rng(seed)
    time = np.arange(-MOST_FRAMES, count + MOST_FRAMES)
    force_n = 20 * np.clip(np.sin(time / 12), 0, None)
    change = np.sqrt(force_n) + rng.normal(scale=0.1, size=len(time))
    inner = slice(MOST_FRAMES, MOST_FRAMES + count)
    return np.roll(change, late)[inner], force_n[inner] + rng.normal(scale=0.2, size=count)


@pytest.mark.parametrize("late", [-12, -9, 9, MOST_FRAMES])
def test_how_late_frames_are(late):
    found = delay("pear", *pressed(late))
    assert (found.recording, abs(found.frames - late) <= 1) == ("pear", True)
    assert found.correlation > 0.9
    assert found.without < found.correlation - 0.2


def test_what_is_in_time_says_nothing():
    for late in (0, 1, -1):
        assert delay("pear", *pressed(late)) is None


def test_few_frames_say_nothing():
    for count in (SHORTEST - 1, SHORTEST):
        force_n = np.exp(-(((np.arange(count) - 10) / 2) ** 2))
        found = delay("short", np.roll(force_n, 9), force_n)
        assert (found is None) == (count < SHORTEST)


def test_what_cannot_be_known():
    change, force_n = pressed(9)
    rng = np.random.default_rng(2)
    assert delay("noise", rng.normal(size=90), rng.normal(size=90)) is None
    for one, other in ((np.zeros(90), force_n), (change, np.zeros(90))):
        assert delay("rest", np.resize(one, 90), np.resize(other, 90)) is None


def test_each_recording_has_its_own():
    """Their frames may be mixed, but each one's are in order."""
    parts = {name: pressed(late, seed=late + 20) for name, late in (("cup", 0), ("pear", 8), ("nut", -9))}
    change, force_n = (np.stack([part[k] for part in parts.values()], axis=1).ravel() for k in (0, 1))
    found = delays([*parts] * 90, change, force_n)
    assert [one.recording for one in found] == ["pear", "nut"]
    np.testing.assert_allclose([one.frames for one in found], [8, -9], atol=1)
