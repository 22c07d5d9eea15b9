"""A network's depth is that of the float pipeline, in both modes, with bridged slopes or without."""

import numpy as np
import pytest

from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.training.whole_frames.network_depth import depth_mae_mm, found_depth_mm
from fastac.sensor.geometry import rest_depth_mm


@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_depth_is_the_float_pipeline_s(tiny_data, make_scene, mode):
    scene = make_scene(poisson={"mode": mode})
    network, rest = PixelNetwork(tiny_data.frames.shape[-1] + 2, (5, 4)), rest_depth_mm(scene.sensor)
    pipeline = FloatPipeline.from_arrays(network.arrays, scene, tiny_data.background, rest)
    index = np.array([0, 3])
    expected = pipeline.run(tiny_data.frames[index], wanted=["depth_mm"]).depth_mm[:, 1:-1, 1:-1]
    found = found_depth_mm(network, tiny_data.frames[index], tiny_data, scene, rest_depth_mm=rest)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * np.abs(expected).max())
    error = depth_mae_mm(network, tiny_data, scene, index, rest_depth_mm=rest)
    truth = tiny_data.depth_mm[index][:, 1:-1, 1:-1]
    assert error == pytest.approx(np.abs(found - truth).mean(), rel=1e-6)
