# amaranth: UnusedElaboratable=no
"""The darkness of a pixel equals its integers for all lanes and channels, and thresholds can be loaded."""

import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.dots.darkness import DarknessStream
from fastac.models.integer.dot_windows import DotWindows
from fastac.sim.check_stream import check, pack


def frames_of(windows, rng):
    """Random pixels, black, white, and each block's threshold, one above and one below."""
    height, width = windows.image
    random = rng.integers(0, 256, (3, height, width, windows.channels))
    near = []
    for step in (-1, 0, 1):
        total = np.kron(windows.threshold, np.ones((4, 4), int)) + step
        share = np.clip(total[..., None] - 255 * np.arange(windows.channels), 0, 255)
        near.append(share)
    return np.stack([*random, 0 * random[0], 0 * random[0] + 255, *near]).astype(np.uint8)


@pytest.mark.parametrize(("lanes", "channels"), [(1, 3), (2, 4), (4, 4), (4, 1)])
@pytest.mark.quick("4-4", mutate=["1-3"])
def test_bit_exact_to_golden_model(tmp_path, lanes, channels):
    rng = np.random.default_rng(lanes)
    threshold = rng.integers(1, 255 * channels, (4, 5))
    threshold[0, 0], threshold[1, 1] = 0, 255 * channels
    windows = DotWindows(threshold, channels, 1)
    frames = frames_of(windows, rng)
    dark = windows.darkness(frames)
    assert {0, 1, windows.darkest} <= set(dark.ravel().tolist())
    dut = DarknessStream(windows, lanes=lanes)
    check(
        dut,
        "darkness",
        tmp_path,
        inputs=pack(frames.reshape(-1, lanes * channels), 8),
        expected=pack(dark.reshape(-1, lanes), windows.darkness_width),
        latencies=[(k, k, dut.latency) for k in range(8)],
        elastic=True,
    )


def test_other_thresholds_can_be_loaded():
    rng = np.random.default_rng(5)
    built, loaded = (DotWindows(rng.integers(0, 1021, (4, 4)), 4, 1, loadable=True) for _ in range(2))
    frames = frames_of(loaded, rng)
    dut = DarknessStream(built, lanes=4)
    expected, found = pack(loaded.darkness(frames).reshape(-1, 4), 10), []

    async def bench(ctx):
        for address, value in enumerate(loaded.threshold.ravel()):
            ctx.set(dut.threshold.en, 1)
            ctx.set(dut.threshold.addr, address)
            ctx.set(dut.threshold.data, int(value))
            await ctx.tick()
        ctx.set(dut.threshold.en, 0)
        ctx.set(dut.o.ready, 1)
        words = pack(frames.reshape(-1, 16), 8)
        for word in [*words, *[0] * dut.latency]:
            ctx.set(dut.i.payload.as_value(), word)
            ctx.set(dut.i.valid, len(found) < len(words))
            *_, valid, payload = await ctx.tick().sample(dut.o.valid, dut.o.payload.as_value())
            found.extend([payload] if valid else [])

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert found[: len(expected)] == expected
