# amaranth: UnusedElaboratable=no
import json

import numpy as np
import pytest

from fastac.gateware.network.background import BackgroundSubtraction
from fastac.models.integer.features import coordinate_codes, integer_features
from fastac.sim.check_stream import check, pack
from fastac.sim.runner import simulate


@pytest.mark.parametrize(
    ("height", "width", "channels", "lanes"), [(4, 6, 3, 1), (5, 12, 3, 4), (1, 2, 1, 2)]
)
@pytest.mark.quick("5-12-3-4")
def test_capture(tmp_path, height, width, channels, lanes):
    rng = np.random.default_rng(1)
    frames = rng.integers(0, 256, (32, height, width, channels))
    frames[0], frames[1], frames[2], frames[3] = 0, 255, 0, 255
    background = rng.integers(0, 256, (height, width, channels)).astype(np.uint8)
    u, v = rng.integers(-256, 256, width), rng.integers(-256, 256, height)
    u[0], v[0], u[-1], v[-1] = -256, 255, 255, -256
    dut = BackgroundSubtraction(height, width, channels, u, v, background, lanes=lanes)
    bench = {
        "frames": frames.tolist(),
        "background": background.tolist(),
        "coordinate_u": u.tolist(),
        "coordinate_v": v.tolist(),
        "lanes": lanes,
        "latency": dut.latency,
        "stalls": [0, 0.3, 0.9],
        "seed": 1,
        "timeout_cycles": 100_000,
    }
    path = tmp_path / "background.json"
    path.write_text(json.dumps(bench))
    simulate(dut, "background", "fastac.sim.benches.background", tmp_path, BENCH=str(path))


def test_features_bit_exact_to_golden_model(tmp_path):
    """Without a capture, the features equal those that the network is trained with."""
    rng = np.random.default_rng(2)
    background = rng.choice([0, 1, 254, 255], (6, 8, 4)).astype(np.uint8)
    frames = rng.choice([0, 1, 254, 255], (3, 6, 8, 4)).astype(np.uint8)
    u, v = coordinate_codes(8), coordinate_codes(6)
    features = integer_features(frames, background)
    assert features.min() == -255
    assert features.max() == 255
    check(
        BackgroundSubtraction(6, 8, 4, u, v, background, lanes=2),
        "background",
        tmp_path,
        elastic=True,
        inputs=pack(frames.reshape(3 * 24, -1), 8),
        expected=pack(features.astype(int).reshape(3 * 24, -1), 9),
        latencies=[(k, k, 3) for k in range(3 * 24)],
        flags={"captured": 0},
    )


def test_invalid_arguments():
    good = {
        "height": 4,
        "width": 6,
        "channels": 3,
        "coordinate_u": coordinate_codes(6),
        "coordinate_v": coordinate_codes(4),
        "background": np.zeros((4, 6, 3), dtype=np.uint8),
        "lanes": 2,
    }

    def refused(message, **changes):
        with pytest.raises(ValueError, match=message):
            BackgroundSubtraction(**(good | changes))

    refused(r"lanes 3: expected one of \(1, 2, 4\)", lanes=3)
    refused("width 6: expected a multiple of 4 lanes", lanes=4)
    refused(r"coordinate_u \(5,\): expected \(6,\)", coordinate_u=np.zeros(5, dtype=int))
    refused("coordinate_v -257 to 0: expected -256 to 255", coordinate_v=np.array([0, 0, -257, 0]))
    refused(r"background \(4, 6, 4\) uint8: expected \(4, 6, 3\)", background=np.zeros((4, 6, 4), np.uint8))
    refused(r"background \(4, 6, 3\) int64: .* uint8", background=np.zeros((4, 6, 3), np.int64))
