"""Slopes of surfaces among other fields, and among channels."""

import numpy as np
import pytest
import torch

from fastac.models.training.force.integrability import curl_share, derivatives, integrable_mixtures


def test_derivatives_of_planes():
    rows, columns = np.mgrid[:5, :7].astype(float)
    plane = (3 * columns - 2 * rows)[None, ..., None]
    along_x, along_y = derivatives(plane)
    np.testing.assert_array_equal(along_x, np.full((1, 4, 6, 1), 3))
    np.testing.assert_array_equal(along_y, np.full((1, 4, 6, 1), -2))


class TestCurlShare:
    Y, X = torch.meshgrid(torch.arange(9.0) - 4, torch.arange(8.0) - 3.5, indexing="ij")

    def share(self, p, q):
        return float(curl_share(torch.stack([p, q], dim=-1)[None]))

    def test_slopes_of_a_surface_have_none(self):
        """Of z = x² + 3xy − y²: p = 2x + 3y, q = 3x − 2y."""
        assert self.share(2 * self.X + 3 * self.Y, 3 * self.X - 2 * self.Y) == 0

    def test_a_rotation_is_all_curl(self):
        assert self.share(-self.Y, self.X) == pytest.approx(2)

    def test_noise_of_any_scale_is_half_curl(self):
        noise = torch.randn((20, 40, 40, 2), generator=torch.Generator().manual_seed(1))
        for scale in (1e-3, 1.0, 1e3):
            assert float(curl_share(scale * noise)) == pytest.approx(0.5, rel=0.05)

    def test_no_slope_is_no_curl(self):
        """And no division by zero, backwards neither."""
        flat = torch.zeros((1, 4, 4, 2), requires_grad=True)
        share = curl_share(flat)
        share.backward()
        assert share == 0
        assert not flat.grad.any()


class TestIntegrableMixtures:
    def test_channels_are_unmixed_up_to_one_factor(self, dents):
        slopes, mixing = dents
        noise = 1e-3 * np.random.default_rng(3).standard_normal((*slopes.shape[:3], 3))
        found = mixing @ integrable_mixtures(slopes @ mixing + noise).T
        np.testing.assert_allclose(found / found[0, 0], np.eye(2), atol=0.02)

    def test_equal_channels_are_no_reason_to_fail(self, dents):
        slopes, mixing = dents
        change = np.concatenate([slopes @ mixing] * 2, axis=-1)
        found = np.concatenate([mixing] * 2, axis=-1) @ integrable_mixtures(change).T
        np.testing.assert_allclose(found / found[0, 0], np.eye(2), atol=0.02)

    def test_without_any_difference_they_are_finite(self):
        assert np.isfinite(integrable_mixtures(np.zeros((2, 5, 5, 3)))).all()
