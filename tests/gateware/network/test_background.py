# amaranth: UnusedElaboratable=no
import json

import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.network.background import BackgroundSubtraction
from fastac.models.integer.features import coordinate_codes, integer_features
from fastac.models.integer.light_level import followed
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


@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.quick("4")
def test_light_is_levelled_bit_exact_to_the_model(tmp_path, lanes):
    """Frames that follow one another at once, of which the last row has few beats; also with stalls."""
    rng = np.random.default_rng(4)
    background = rng.integers(0, 256, (5, 16, 3)).astype(np.uint8)
    drift = np.cumsum(rng.integers(-2, 3, (40, 3)), axis=0)
    frames = background + drift[:, None, None] + rng.integers(-3, 4, (40, *background.shape))
    frames = np.where(rng.random(frames.shape) < 0.2, rng.integers(0, 256, frames.shape), frames)
    frames = np.clip(frames, 0, 255).astype(np.uint8)
    seen, last = followed(frames, background)
    assert (seen != frames).mean() > 0.3
    assert last.any()
    u, v = coordinate_codes(16), coordinate_codes(5)
    beats = len(frames) * 5 * 16 // lanes
    dut = BackgroundSubtraction(5, 16, 3, u, v, background, lanes=lanes, level_light=True)
    check(
        dut,
        "background",
        tmp_path,
        elastic=True,
        inputs=pack(frames.reshape(beats, -1), 8),
        expected=pack(integer_features(seen, background).astype(int).reshape(beats, -1), 9),
        latencies=[(k, k, dut.latency) for k in range(beats)],
        flags={"captured": 0},
    )


def test_a_captured_frame_is_not_shifted_and_leaves_the_shift():
    rng, captured = np.random.default_rng(5), 12
    background = rng.integers(0, 256, (5, 16, 3)).astype(np.uint8)
    drift = np.arange(24)[:, None] * np.array([1, -1, 0]) // 2
    noise = rng.integers(-2, 3, (24, *background.shape))
    frames = np.clip(background + drift[:, None, None] + noise, 0, 255).astype(np.uint8)
    before, shift = followed(frames[:captured], background)
    assert shift.any()
    after, _ = followed(frames[captured + 1 :], frames[captured], shift)
    expected = np.concatenate(
        [
            integer_features(before, background),
            integer_features(frames[captured : captured + 1], frames[captured]),
            integer_features(after, frames[captured]),
        ]
    )
    u, v = coordinate_codes(16), coordinate_codes(5)
    dut = BackgroundSubtraction(5, 16, 3, u, v, background, lanes=4, level_light=True)
    beats, received = frames.reshape(-1, 4, 3), []

    async def bench(ctx):
        ctx.set(dut.o.ready, 1)
        for clock in range(len(beats) + dut.latency):
            given = clock < len(beats)
            ctx.set(dut.i.valid, int(given))
            ctx.set(dut.capture, int(clock == captured * len(beats) // len(frames)))
            if given:
                ctx.set(dut.i.payload, beats[clock].tolist())
            if ctx.get(dut.o.valid):
                received.append([[ctx.get(value) for value in pixel] for pixel in dut.o.payload])
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    np.testing.assert_array_equal(np.array(received).reshape(expected.shape), expected)
