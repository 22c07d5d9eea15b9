# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.network.feature_smoothing import FeatureSmoothing
from fastac.models.integer.features import coordinate_codes
from fastac.models.integer.smoothing import smoothed
from fastac.sim.check_stream import check, pack


def features(difference: np.ndarray) -> np.ndarray:
    """Differences (frames, H, W, C) with the coordinate codes behind them."""
    height, width = difference.shape[1:3]
    u = np.broadcast_to(coordinate_codes(width), difference.shape[:3])
    v = np.broadcast_to(coordinate_codes(height)[:, None], difference.shape[:3])
    return np.concatenate([difference, u[..., None], v[..., None]], axis=-1).astype(int)


def hardware(window_px: int, difference: np.ndarray, **choice: int) -> FeatureSmoothing:
    _, height, width, channels = difference.shape
    return FeatureSmoothing(window_px, channels, coordinate_codes(width), coordinate_codes(height), **choice)


@pytest.mark.parametrize(
    ("window_px", "lanes", "height", "width", "channels"),
    [(2, 1, 3, 5, 3), (4, 4, 5, 16, 4), (8, 2, 6, 8, 1), (4, 1, 3, 2, 1), (8, 4, 9, 8, 3)],
)
@pytest.mark.quick("4-4-5-16-4")
def test_bit_exact_to_the_model(tmp_path, window_px, lanes, height, width, channels):
    """Frames that follow one another at once, with stalls, and apart: the last is pushed out by none."""
    rng = np.random.default_rng(1)
    difference = rng.integers(-255, 256, (6, height, width, channels))
    difference[1], difference[2] = 255, -255  # reach the bounds of all sums
    difference[3] = 0
    dut = hardware(window_px, difference, lanes=lanes)
    beats = len(difference) * height * width // lanes
    check(
        dut,
        "feature_smoothing",
        tmp_path,
        elastic=True,
        inputs=pack(features(difference).reshape(beats, -1), 9),
        expected=pack(features(smoothed(difference, window_px)).reshape(beats, -1), 9),
        latencies=[(k, k, dut.latency) for k in range(beats)],
    )
