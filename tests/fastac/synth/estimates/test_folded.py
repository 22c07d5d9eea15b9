"""What folded designs are counted for, and that each fold takes less than the one before."""

import json
from itertools import pairwise

import numpy as np
import pytest

from fastac.models.random_bundle import random_bundle, scene
from fastac.scenes.pace import PACES
from fastac.synth import fits
from fastac.synth.estimates import folded, resources

SLOPES = {
    "outputs": ("depth", "force_xyz"),
    "solver": "tridiagonal",
    "source": "slopes",
    "mode": "difference",
}


@pytest.fixture(scope="module")
def by_pace(tmp_path_factory):
    """The same integers at every pace of one pixel a clock and less, the slowest first."""
    pipeline = random_bundle(
        tmp_path_factory.mktemp("b") / "b", scene(size=32, **SLOPES), hidden=(16, 16)
    ).pipeline
    found = []
    for pace in PACES[:5]:
        hardware = pipeline.scene.hardware.model_copy(update={"pixels_per_clock": pace.value})
        found.append(pipeline.replace(scene=pipeline.scene.model_copy(update={"hardware": hardware})))
    return found


def test_a_slower_pace_takes_less(by_pace):
    areas = [fits.area(pipeline) for pipeline in by_pace]
    for slower, faster in pairwise(areas):
        assert sum(slower.multipliers.values()) < sum(faster.multipliers.values())
        for stage in ("normals", "transforms"):
            assert slower.luts[stage] < faster.luts[stage]


def test_only_folded_stages_are_counted_otherwise(by_pace):
    slow, whole = (resources.features(pipeline) for pipeline in (by_pace[0], by_pace[-1]))
    assert list(slow) == list(whole)
    other = {name for name in slow if slow[name] != whole[name]}
    assert other == set(folded.STAGES)


def test_every_folded_stage_has_samples():
    content = json.loads(resources.FOLDED_SAMPLES.read_text())
    assert set(content["factors"]) == set(folded.STAGES)
    counted = {stage for sample in content["samples"] for stage in sample["counted"]}
    assert counted == set(folded.STAGES)
    assert np.abs(content["left_out_errors_percent"]["lut"]).max() < 40
