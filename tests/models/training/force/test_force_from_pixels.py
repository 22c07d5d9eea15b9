"""The force model of averaged frames against the one of whole frames."""

import numpy as np
import pytest
import torch

from fastac.models.floating.network import predict, slopes_of
from fastac.models.integer.features import integer_features
from fastac.models.training.force import force_from_pixels, smooth_weights
from fastac.models.training.force.force_from_pixels import ForceFromPixels
from fastac.models.training.force.force_start import linear_network


def test_blocks_leave_enough_of_a_frame():
    sizes = [(16, 16), (40, 44), (64, 64), (128, 128), (256, 256), (96, 128), (100, 128), (66, 66)]
    assert [force_from_pixels.block_size(*size) for size in sizes] == [1, 2, 2, 4, 8, 4, 4, 2]


class TestForceFromPixels:
    SHAPE = (64, 64, 3)

    @pytest.fixture
    def model(self):
        rng = np.random.default_rng(1)
        torch.manual_seed(1)
        network = linear_network(rng.normal(size=(2, 3)).astype(np.float32))
        return ForceFromPixels(network, rng.normal(size=(2, 4, 4, 2)), self.SHAPE, 1e3)

    def test_rest_is_no_force(self, model):
        with torch.no_grad():
            for layer in model.network.linear_layers:
                layer.weight += 0.1
            assert not model(torch.zeros(1, 32, 32, 3)).any()
            assert model(torch.ones(1, 32, 32, 3)).any()

    def test_averaged_frames_have_the_force_of_whole_ones_where_all_is_linear(self, model):
        """Exact for frames that are constant within each block."""
        background = np.full(self.SHAPE, 100, np.uint8)
        coarse = np.random.default_rng(2).integers(80, 120, (3, 32, 32, 3), dtype=np.uint8)
        frames = coarse.repeat(2, axis=1).repeat(2, axis=2)
        slopes = slopes_of(predict(model.network, integer_features(frames, background)), 1e3)
        waves = smooth_weights.cosine_basis(64, 4)
        fields = model.fields.detach().numpy() * model.unit / 4
        weights = np.einsum("ik,jl,aklt->aijt", waves, waves, fields)
        change = force_from_pixels.block_averages(frames.astype(np.float32) - background, 2)
        np.testing.assert_array_equal(change, coarse.astype(np.float32) - 100)
        with torch.inference_mode():
            found = model(torch.from_numpy(change)).numpy()
        np.testing.assert_allclose(found, np.einsum("nijt,aijt->na", slopes, weights), rtol=1e-3, atol=1e-3)
