# amaranth: UnusedElaboratable=no
"""The force of skin and dots equals the integers, whichever comes first."""

import numpy as np
import pytest

from fastac.gateware.dot_force import DotForceStream
from fastac.gateware.force.force_sum import ForceSum
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import pack


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A pipeline, what it finds in frames, the darkness of their pixels and the forces of their skin."""
    wanted = scene(("force_x", "force_z"), solver="adjoint", dots=True, lanes=2)
    pipeline = random_bundle(tmp_path_factory.mktemp("dots") / "bundle", wanted).pipeline
    images = frames(pipeline.background, (0, 10, 255, 40, 255))
    found = Emulator(pipeline).run(images)
    windows = pipeline.follower.windows
    darkness = pack(windows.darkness(images).reshape(-1, 2), windows.darkness_width)
    skin = found.force_raw - pipeline.dot_force(found.dot_shift_words)
    return pipeline, found, darkness, pack(skin, pipeline.force.width)


@pytest.mark.parametrize("dots_first", [False, True])
def test_bit_exact_whichever_comes_first(known, dots_first):
    pipeline, found, darkness, skin = known
    dut = DotForceStream(pipeline, lanes=2)
    last = {"darkness": len(darkness) // len(skin) - 1, "skin": 0}
    gaps = {"skin": 2 * len(darkness)} if dots_first else {}
    streams, taken = run_streams(
        dut, {"darkness": darkness, "skin": skin}, {"o": len(skin)}, start=gaps, clocks=20_000
    )
    assert streams["o"] == pack(found.force_raw, pipeline.force_width)
    if dots_first:
        assert taken["o"][0] - taken["skin"][0] == ForceSum.latency
    else:
        first = taken["darkness"][last["darkness"]]
        assert taken["o"][0] - first == dut.latency + ForceSum.latency


def test_formulas(known):
    pipeline, *_ = known
    dut = DotForceStream(pipeline, lanes=2)
    assert dut.interval == pipeline.background.shape[0] * pipeline.background.shape[1] // 2
    assert dut.multipliers == 2 * 2
    assert np.abs(pipeline.dot_force.weighted.weight).max() > 0
