import json
from dataclasses import replace

import numpy as np
import pytest

from fastac import accuracy
from fastac.models import accuracy as metrics
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.sensor.dataset import DatasetError


def test_choose_takes_a_split_or_all(tiny_data, tmp_path):
    np.testing.assert_array_equal(accuracy.choose(tiny_data, "all", tmp_path), np.arange(34))
    chosen = accuracy.choose(tiny_data, "validation", tmp_path)
    assert set(tiny_data.split[chosen]) == {"validation"}
    assert len(chosen) == 8
    train_only = replace(tiny_data, split=np.full(34, "train"))
    with pytest.raises(DatasetError, match=f"{tmp_path}: split: no frame is in 'test'"):
        accuracy.choose(train_only, "test", tmp_path)


@pytest.mark.parametrize(
    ("size", "count", "expected"),
    [(9, 3, [0, 4, 8]), (10, 2, [0, 9]), (3, 3, [0, 1, 2]), (2, 5, [0, 1]), (1, 4, [0])],
)
def test_spread_reaches_from_the_first_to_the_last(size, count, expected):
    index = np.arange(size) * 10 + 3
    np.testing.assert_array_equal(accuracy.spread(index, count), index[expected])


def test_each_recording_is_seen_against_its_own_rest(tiny_bundle, tiny_data):
    brighter = replace(tiny_data, background=tiny_data.background + 5)
    pipeline = accuracy.of_dataset(tiny_bundle.pipeline, brighter)
    np.testing.assert_array_equal(pipeline.background, tiny_data.background + 5)
    assert pipeline.layers is tiny_bundle.pipeline.layers


def test_compare_runs_both_pipelines_on_the_same_frames(tiny_bundle, tiny_data):
    index = tiny_data.indices("test")[[4, 1]]
    errors, results = accuracy.compare(tiny_bundle, tiny_data, index, progress=False)
    pipelines = {"float": FloatPipeline.from_bundle(tiny_bundle), "integer": Emulator(tiny_bundle.pipeline)}
    for name, pipeline in pipelines.items():
        alone = pipeline.run(tiny_data.frames[index])
        for key, array in vars(alone).items():
            np.testing.assert_array_equal(getattr(results[name], key), array)
        rest = pipeline.run(tiny_data.background[None])
        assert errors[name] == metrics.evaluate(alone, rest, tiny_data, index, tiny_bundle.scene)
    for key, growth in errors["growth_percent"].items():
        ratio = errors["integer"][key] / errors["float"][key]
        assert growth == pytest.approx(100 * (ratio - 1))
    assert set(errors["growth_percent"]) == set(errors["float"]) - {"force_r2"}
    json.dumps(errors, allow_nan=False)


def test_saturated_values_are_counted(tiny_bundle, tiny_data):
    frames = tiny_data.frames.copy()
    frames[0], frames[1] = 0, 255
    wild = replace(tiny_data, frames=frames)
    errors, results = accuracy.compare(tiny_bundle, wild, np.array([0, 1]), progress=False)
    found = results["integer"]
    assert errors["saturated_values"] == {
        "gradient_saturated": found.gradient_saturated.sum(),
        "displacement_saturated": found.displacement_saturated.sum(),
    }


def test_equal_loads_leave_strict_json(tiny_bundle, tiny_data):
    """One load only: R² does not exist, and nothing is NaN."""
    index = np.flatnonzero((tiny_data.split == "test") & (tiny_data.force_n[:, 2] < 0.04))
    errors, _ = accuracy.compare(tiny_bundle, tiny_data, index, progress=False)
    assert "force_r2" not in errors["float"]
    assert "force_nmae_percent" in errors["integer"]
    json.dumps(errors, allow_nan=False)
