from dataclasses import replace

import numpy as np
import pytest

from fastac.flow.slope_sum_errors import layers_errors, network_errors
from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.network import PixelNetwork
from fastac.models.training.whole_frames import force_features

OF_SLOPES = {"poisson": {"solver": "adjoint"}, "force": {"fit": "slopes", "clamp": False}}


def test_depth_counts_where_the_scene_finds_it_and_the_dataset_knows_it(tiny_data, tiny_scene, make_scene):
    for errors in (network_errors, layers_errors):
        assert len(errors(tiny_data, tiny_scene)) == 1
        assert errors(replace(tiny_data, depth_mm=None), tiny_scene) == []
        assert errors(tiny_data, make_scene(outputs=["force_z"], **OF_SLOPES)) == []
        learned = make_scene(training={"depth_weight": 1.0, "force_weight": 0.1})
        assert len(errors(tiny_data, learned)) == 1  # kernels have no error of slopes


def test_depth_is_judged_on_the_validation_split(tiny_data, tiny_bundle):
    index, scene = tiny_data.indices("validation"), tiny_bundle.scene
    result = Emulator(tiny_bundle.pipeline).run(tiny_data.frames[index])
    [error] = layers_errors(tiny_data, scene)
    assert error(tiny_bundle.pipeline.layers) == accuracy.depth_mae_mm(result, tiny_data, index)
    [error] = network_errors(tiny_data, scene)
    network = PixelNetwork.from_arrays(tiny_bundle.floats)
    assert error(network) == pytest.approx(accuracy.depth_mae_mm(result, tiny_data, index), rel=0.2)
    first, *_ = network.linear_layers
    first.weight.data *= 0
    assert error(network) > 1.5 * accuracy.depth_mae_mm(result, tiny_data, index)


def test_the_force_counts_where_the_network_learned_from_it(tiny_bundle, tiny_data, make_scene, monkeypatch):
    """Integers without slopes know no force: each is off by all of it, and their own slopes do better."""
    monkeypatch.setattr(force_features, "SLOPES_SIZE", 2)  # for nine presses
    scene = make_scene(outputs=["force_z"], **OF_SLOPES, training={"force_weight": 3.0})
    assert network_errors(tiny_data, scene) == []
    [error] = layers_errors(tiny_data, scene)
    *hidden, last = tiny_bundle.pipeline.layers
    flat = [*hidden, replace(last, weight=0 * last.weight)]
    force_n = tiny_data.forces_n(tiny_data.indices("train"), scene.force_axes)
    assert error(flat) == pytest.approx(np.abs(force_n).mean(), rel=1e-5)
    assert error([*hidden, last]) < 0.8 * error(flat)
