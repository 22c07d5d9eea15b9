import numpy as np
import pytest

from fastac.models.integer.laplacian import divergence_of
from fastac.models.integer.source import PoissonSource


def source_by_loop(slopes: np.ndarray, divergence: str) -> list[list[int]]:
    p, q = slopes[..., 0].tolist(), slopes[..., 1].tolist()
    height, width = slopes.shape[:2]
    back = 1
    ahead = 1 if divergence == "central" else 0
    return [
        [p[i][j + ahead] - p[i][j - back] + q[i + ahead][j] - q[i - back][j] for j in range(1, width - 1)]
        for i in range(1, height - 1)
    ]


class TestPoissonSource:
    @pytest.mark.parametrize("divergence", ["central", "backward"])
    def test_equals_differences_of_neighbours(self, divergence):
        rng = np.random.default_rng(1)
        slopes = rng.integers(-(2**16), 2**16, (2, 7, 7, 2))
        offset = rng.integers(-1000, 1000, (5, 5))
        found = PoissonSource(divergence, 17, offset)(slopes)
        for frame, one in zip(slopes, found, strict=True):
            np.testing.assert_array_equal(one, np.array(source_by_loop(frame, divergence)) - offset)

    @pytest.mark.parametrize("divergence", ["central", "backward"])
    def test_the_worst_signs_reach_the_bound(self, divergence):
        limit = 2**7 - 1
        offset = np.zeros((4, 4), int)
        offset[2, 1] = -50
        source = PoissonSource(divergence, 8, offset)
        # The linear map to pixel (2, 1) by unit slopes, then the signs that make all of it add up.
        weight = np.zeros((6, 6, 2), int)
        for index in np.ndindex(weight.shape):
            unit = np.zeros_like(weight)
            unit[index] = 1
            weight[index] = divergence_of(unit, divergence)[2, 1]
        assert np.abs(weight).sum() == source.terms
        assert source(np.sign(weight) * limit)[2, 1] == source.bound == 4 * limit + 50
        assert source.bound < 2 ** (source.width - 1)

    def test_unit_slopes_of_a_plane_have_no_source(self):
        plane = np.broadcast_to([3, -5], (6, 8, 2))
        for divergence in ("central", "backward"):
            assert not divergence_of(plane, divergence).any()
            assert divergence_of(plane, divergence).shape == (4, 6)

    def test_refuses_an_unknown_divergence(self):
        with pytest.raises(ValueError, match="divergence 'forward': expected central or backward"):
            PoissonSource("forward", 8, np.zeros((4, 4), int))
