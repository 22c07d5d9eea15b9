# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.network.feature_smoothing import FeatureSmoothing
from fastac.models.integer.features import coordinate_codes
from fastac.models.integer.smoothing import smoothed
from fastac.sim.check_stream import check, pack

CLOCKS = 10_000


def features(difference: np.ndarray) -> np.ndarray:
    """Differences (frames, H, W, C) with the coordinate codes behind them."""
    height, width = difference.shape[1:3]
    u = np.broadcast_to(coordinate_codes(width), difference.shape[:3])
    v = np.broadcast_to(coordinate_codes(height)[:, None], difference.shape[:3])
    return np.concatenate([difference, u[..., None], v[..., None]], axis=-1).astype(int)


def hardware(window_px: int, difference: np.ndarray, **choice: int) -> FeatureSmoothing:
    _, height, width, channels = difference.shape
    return FeatureSmoothing(window_px, channels, coordinate_codes(width), coordinate_codes(height), **choice)


def test_what_is_empty_takes_a_paced_frame_at_once():
    """Every other frame comes when those before have left, and is taken in whatever clock it comes."""
    rng = np.random.default_rng(2)
    difference = rng.integers(-255, 256, (30, 2, 3, 2))
    dut = hardware(2, difference, lanes=1, fold=4)
    words = features(difference).reshape(-1, 4).tolist()
    expected = features(smoothed(difference, 2)).reshape(-1, 4).tolist()
    pauses = rng.integers(1, 7, len(words)) * (rng.random(len(words)) < 0.2)
    found = []

    async def feed(ctx):
        for k, word in enumerate(words):
            if k % 12 == 0:
                for _ in range(CLOCKS):
                    if len(found) == k:
                        break
                    await ctx.tick()
                await ctx.tick().repeat(dut.fold)
                for _ in range(k // 12 % 5):
                    assert ctx.get(dut.i.ready)
                    await ctx.tick()
                assert ctx.get(dut.i.ready)
            elif pauses[k]:
                await ctx.tick().repeat(int(pauses[k]))
            ctx.set(dut.i.payload, [word])
            ctx.set(dut.i.valid, 1)
            await ctx.tick().until(dut.i.ready)
            ctx.set(dut.i.valid, 0)

    async def take(ctx):
        for ready in rng.random(CLOCKS) < 0.4:
            ctx.set(dut.o.ready, int(ready))
            _, _, moves, payload = await ctx.tick().sample(dut.o.valid & dut.o.ready, dut.o.payload[0])
            if moves:
                found.append([*payload])
            if len(found) == len(words):
                break

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(feed, background=True)  # `take` ends in any case
    simulator.add_testbench(take)
    simulator.run()
    assert found == expected


@pytest.mark.parametrize(
    ("window_px", "lanes", "fold", "height", "width", "channels"),
    [
        (2, 1, 1, 3, 5, 3),
        (4, 4, 1, 5, 16, 4),
        (8, 2, 1, 6, 8, 1),
        (4, 1, 1, 3, 2, 1),
        (8, 4, 1, 9, 8, 3),
        (4, 1, 4, 4, 5, 3),
    ],
)
@pytest.mark.quick("4-4-1-5-16-4")
def test_bit_exact_to_the_model(tmp_path, window_px, lanes, fold, height, width, channels):
    """Frames that follow one another at once, with stalls, and apart: the last is pushed out by none.

    Many frames: the lowest bit of a difference changes few means.
    """
    rng = np.random.default_rng(1)
    difference = rng.integers(-255, 256, (40, height, width, channels))
    difference[1], difference[2] = 255, -255  # reach the bounds of all sums
    difference[3] = 0
    dut = hardware(window_px, difference, lanes=lanes, fold=fold)
    beats = len(difference) * height * width // lanes
    check(
        dut,
        "feature_smoothing",
        tmp_path,
        elastic=fold == 1,
        inputs=pack(features(difference).reshape(beats, -1), 9),
        expected=pack(features(smoothed(difference, window_px)).reshape(beats, -1), 9),
        latencies=[(k, k, dut.latency) for k in range(beats)],
    )
