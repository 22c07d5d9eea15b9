# amaranth: UnusedElaboratable=no
"""The force of skin and dots equals the integers, whichever comes first."""

import dots
import numpy as np
import pytest

from fastac.gateware.dot_force import DotForceStream
from fastac.gateware.force.force_sum import ForceSum
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import pack


def of_scene(folder, wanted):
    """A pipeline, what it finds in frames, the darkness of their pixels and the forces of their skin."""
    pipeline = random_bundle(folder, wanted).pipeline
    images = frames(pipeline.background, (0, 10, 255, 40, 255))
    found = Emulator(pipeline).run(images)
    windows = pipeline.follower.windows
    darkness = pack(windows.darkness(images).reshape(-1, 2), windows.darkness_width)
    skin = found.force_raw - pipeline.dot_force(found.dot_shift_words)
    return pipeline, found, darkness, pack(skin, pipeline.force.width)


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    wanted = scene(("force_x", "force_z"), solver="adjoint", dots=True, lanes=2)
    return of_scene(tmp_path_factory.mktemp("dots") / "bundle", wanted)


@pytest.mark.parametrize("dots_first", [False, True])
@pytest.mark.quick("True")
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


def test_shifts_leave_where_slip_is_wanted(known, tmp_path):
    """Dot by dot as they are found; a reader that waits for them delays the force and changes nothing."""
    assert "shifts" not in DotForceStream(known[0], lanes=2).signature.members
    wanted = scene(("force_x", "force_z", "slip"), dots=True, lanes=2)
    pipeline, found, darkness, skin = of_scene(tmp_path / "bundle", wanted)
    expected = {
        "o": pack(found.force_raw, pipeline.force_width),
        "shifts": dots.shift_payloads(pipeline.follower, found.dot_shift_words, found.dots_seen),
    }
    count = {name: len(payloads) for name, payloads in expected.items()}
    given = {"darkness": darkness, "skin": skin}
    for shifts in (0, 0.5):
        stall = dict.fromkeys([*given, "o"], 0) | {"shifts": shifts}
        dut = DotForceStream(pipeline, lanes=2)
        streams, taken = run_streams(dut, given, count, stall=stall, clocks=20_000)
        assert streams == expected
        if not shifts:
            last = taken["darkness"][len(darkness) // len(skin) - 1]
            assert taken["shifts"][len(pipeline.follower.rest) - 1] - last == dut.followed
            assert taken["o"][0] - last == dut.latency + ForceSum.latency


def test_formulas(known):
    pipeline, *_ = known
    dut = DotForceStream(pipeline, lanes=2)
    assert dut.interval == pipeline.background.shape[0] * pipeline.background.shape[1] // 2
    assert dut.multipliers == 2 * 2
    assert np.abs(pipeline.dot_force.weighted.weight).max() > 0
