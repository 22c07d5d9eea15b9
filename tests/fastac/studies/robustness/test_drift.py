"""Faults of marker dots: as many are lost as are damaged, and the frame is flagged."""

import numpy as np
import pytest

from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import random_bundle, scene
from fastac.scenes.sensor_schema import Markers
from fastac.studies.robustness.drift import dot_faults


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    wanted = scene(("force_xyz",), solver="adjoint", dots=True, size=48)
    dots = Markers(spacing_mm=1.5, radius_mm=0.2)
    wanted = wanted.model_copy(update={"sensor": wanted.sensor.model_copy(update={"markers": dots})})
    return random_bundle(tmp_path_factory.mktemp("dots") / "bundle", wanted).pipeline


def lost(pipeline, frames):
    found = Emulator(pipeline).run(frames)
    return (~found.dots_seen[0]).sum(), bool(found.validity[0])


def test_covered_dots_are_lost_and_flagged(pipeline):
    (covered, _, _), good = dot_faults(pipeline), pipeline.background[None]
    assert lost(pipeline, good) == (0, False)
    for level in covered.levels:
        count, flagged = lost(pipeline, covered.apply(good, level))
        assert count == level
        assert flagged == (level > 0)


def test_smeared_dots_are_too_dark(pipeline):
    _, smeared, _ = dot_faults(pipeline)
    count, flagged = lost(pipeline, smeared.apply(pipeline.background[None], smeared.levels[-1]))
    assert count > 0
    assert flagged


def test_doubled_dots_seem_to_have_moved(pipeline):
    *_, doubled = dot_faults(pipeline)
    found = Emulator(pipeline).run(doubled.apply(pipeline.background[None], 1))
    moved = found.dot_shift_words[0].any(axis=-1)
    assert 1 <= moved.sum() + (~found.dots_seen).sum() <= 3
    assert np.array_equal(doubled.apply(pipeline.background[None], 0)[0], pipeline.background)


def test_without_dots_there_is_nothing_to_damage(tmp_path):
    bundle = random_bundle(tmp_path / "bundle", scene(("force_z",)))
    assert dot_faults(bundle.pipeline) == []
