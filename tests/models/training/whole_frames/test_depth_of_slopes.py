import numpy as np
import pytest
import torch

from fastac.models.floating import network as floating
from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import integer_features, scales
from fastac.models.training.whole_frames.depth_of_slopes import DepthOfSlopes, slopes_of
from fastac.models.training.whole_frames.network_depth import found_depth_mm
from fastac.sensor.geometry import rest_depth_mm


def test_slopes_are_those_of_the_float_network():
    """Normals that face away, lie in the image plane or are no normals at all included."""
    rng = np.random.default_rng(1)
    normal = rng.normal(size=(500, 3)).astype(np.float32)
    normal[:4] = [[1, -1, 0], [0, 0, 0], [1, 0, -1], [1e-3, 0, 1e-7]]
    expected = floating.slopes_of(normal.astype(np.float64), 4)
    found = slopes_of(torch.from_numpy(normal), 4).numpy()
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def test_no_gradient_is_infinite():
    normal = torch.tensor([[1.0, -1, 0], [0, 0, 0], [1, 0, -1], [1e-9, 1, 1e-9]], requires_grad=True)
    slopes_of(normal, 4).square().sum().backward()
    assert torch.isfinite(normal.grad).all()


@pytest.mark.parametrize("divergence", ["central", "backward"])
@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_depth_is_the_solver_s(tiny_data, make_scene, mode, divergence):
    scene = make_scene(poisson={"mode": mode, "divergence": divergence})
    torch.manual_seed(1)
    network, rest = PixelNetwork(tiny_data.frames.shape[-1] + 2, (5, 4)), rest_depth_mm(scene.sensor)
    frames = np.concatenate([tiny_data.frames[:2], tiny_data.background[None]])
    x = integer_features(frames, tiny_data.background) * scales(tiny_data.frames.shape[-1])
    with torch.inference_mode():
        slopes = slopes_of(network(torch.from_numpy(x.astype(np.float32))), scene.numbers.slope_limit)
        found = DepthOfSlopes(scene, rest)(slopes[:-1], slopes[-1]).numpy() * scene.sensor.pitch_mm
    expected = found_depth_mm(network, frames[:2], tiny_data, scene, rest_depth_mm=rest)
    if mode == "difference":
        expected -= rest[1:-1, 1:-1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(tiny_data.depth_mm).max())
