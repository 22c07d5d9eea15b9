"""Coverage is counted by groups, and how sure it is follows from their spread."""

import numpy as np
import pytest

from fastac.models.interval_accuracy import covered, lines
from fastac.models.result import Result
from fastac.models.training.force.conformal import wilson
from fastac.sensor.samples import Dataset


def counted(inside: np.ndarray, group: np.ndarray, chosen: np.ndarray | None = None) -> dict:
    """Of forces along z that are 0, with errors of 1 N outside and 0.5 N inside of ± 0.7 N."""
    count = len(inside)
    frames = np.zeros((count, 4, 4, 3), np.uint8)
    split = np.array(["test"] * count)
    data = Dataset(
        0.1,
        ("B", "G", "R"),
        "test",
        frames[0],
        split,
        frames=frames,
        force_n=np.zeros((count, 3), np.float32),
        group=group.astype(str),
    )
    force_n = np.where(inside, 0.5, -1.0)[:, None]
    result = Result(force_n=force_n, force_half_width_n=np.full((count, 1), 0.7))
    return covered(result, data, np.arange(count), (2,), chosen)


def test_each_group_has_the_same_weight():
    inside, group = np.array([1, 1, 1, 1, 0, 0, 1, 0]), np.array([0, 0, 0, 0, 1, 1, 2, 2])
    found = counted(inside, group)
    assert (found["groups"], found["frames"]) == (3, 8)
    assert found["z"]["coverage"] == pytest.approx(0.5)
    assert found["z"]["half_width_n"] == pytest.approx(0.7)
    some = counted(inside, group, np.arange(8) < 6)
    assert (some["groups"], some["frames"]) == (2, 6)
    assert some["z"]["coverage"] == pytest.approx(0.5)


def test_confidence_follows_from_the_spread_between_groups():
    rng = np.random.default_rng(1)
    group = np.repeat(np.arange(50), 10)
    apart = rng.permutation(np.arange(500) >= 50)
    alike = np.repeat(np.arange(50) >= 5, 10)
    spans = []
    for inside, trials in ((apart, 500), (alike, 50)):
        entry = counted(inside, group)["z"]
        assert entry["coverage"] == pytest.approx(0.9)
        low, high = wilson(0.9, trials)
        spans.append(entry["coverage_to"] - entry["coverage_from"])
        assert spans[-1] == pytest.approx(high - low, rel=0.25)
    assert spans[1] > 2 * spans[0]
    entry = counted(np.ones(20, bool), np.arange(20))["z"]
    assert (entry["coverage_from"], entry["coverage_to"]) == pytest.approx(wilson(1.0, 20))


def test_lines():
    found = {"asked": 0.9, "coverage": 0.9, "as_they_are": counted(np.ones(20, bool), np.arange(20))}
    (line,) = lines(found)
    assert line == (
        "intervals, force_z: 100.0% within (95% confidence 83.9 to 100.0%, 20 groups; 90% asked), ± 0.7 N in"
        " the mean"
    )
