"""The float pipeline on a torch device, here the processor, against the float pipeline itself."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.floating.torch_pipeline import TorchPipeline


@pytest.fixture(scope="module")
def pipelines(tiny_bundle, make_scene):
    def of(**changes):
        whole = replace(FloatPipeline.from_bundle(tiny_bundle), scene=make_scene(**changes))
        return whole, TorchPipeline(whole, "cpu")

    return of


@pytest.mark.parametrize("divergence", ["central", "backward"])
@pytest.mark.parametrize("clamp", [True, False])
def test_every_stage_is_the_float_pipeline_s(pipelines, tiny_data, divergence, clamp):
    whole, there = pipelines(poisson={"divergence": divergence}, force={"clamp": clamp})
    result = whole.run(tiny_data.frames[:4])
    for k, frame in enumerate(tiny_data.frames[:4]):
        slopes = there.normals(there.to_device(frame))
        displacement = there.depth(slopes)
        np.testing.assert_allclose(slopes.numpy(), result.slopes[k], atol=1e-5)
        np.testing.assert_allclose(displacement.numpy(), result.displacement_mm[k], atol=1e-5)
        np.testing.assert_allclose(there.force(displacement).numpy(), result.force_n[k], rtol=1e-4, atol=1e-6)
    assert list(there.stages()) == list(whole.stages())
    there.synchronise()


@pytest.mark.parametrize("smoothing_px", [2, 4, 8])
def test_smoothed_differences_are_the_float_pipeline_s(pipelines, smoothing_px):
    """With noise, whose means often end in a half; a mean rounded otherwise would be far off."""
    whole, there = pipelines(network={"smoothing_px": smoothing_px})
    noise = np.random.default_rng(1).integers(-9, 10, whole.background.shape)
    frame = np.clip(whole.background + noise, 0, 255).astype(np.uint8)
    found = there.normals(there.to_device(frame)).numpy()
    np.testing.assert_allclose(found, whole.run(frame[None], wanted=["slopes"]).slopes[0], atol=1e-5)


def test_normals_that_face_away_are_as_steep_as_slopes_can_be(tiny_bundle, tiny_data):
    whole = FloatPipeline.from_bundle(tiny_bundle)
    with torch.no_grad():
        whole.network.linear_layers[-1].bias[2] -= 10
    there = TorchPipeline(whole, "cpu")
    slopes = there.normals(there.to_device(tiny_data.frames[0])).numpy()
    assert (np.abs(slopes) == whole.scene.numbers.slope_limit).all()
    np.testing.assert_array_equal(slopes, whole.run(tiny_data.frames[:1], wanted=["slopes"]).slopes[0])
