# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.hdl import Fragment

from fastac.gateware.force.folded_patch import FoldedPatchForce
from fastac.gateware.force.patch_generator import PatchGenerator
from fastac.gateware.fz_stream import PatchForceStream
from fastac.models.integer.force import PatchForce
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack
from tests.gateware.test_fz_stream import beats, extreme_force, frames_of, map_beats


@pytest.mark.parametrize(
    ("fold", "n", "k", "kernel_bits", "bits", "axes", "signed"),
    [(16, 6, 3, 8, 8, 3, False), (4, 6, 3, 6, 8, 3, True), (2, 5, 5, 8, 8, 2, True)],
)
@pytest.mark.quick("4-6-3-6-8-3-True")
def test_force_of_every_frame(tmp_path, fold, n, k, kernel_bits, bits, axes, signed):
    rng = np.random.default_rng(1)
    force = extreme_force(n, k, kernel_bits, bits, axes, rng, signed)
    q = frames_of(force, rng)
    expected = force(q)
    assert expected[0, 1] == -force.bound, "the bound is reached exactly"
    dut = FoldedPatchForce(force, fold=fold)
    last = [n * n * (f + 1) - 1 for f in range(len(q))]
    check(
        dut,
        "folded_patch_force",
        tmp_path,
        inputs=pack(beats(q, 1, rng), bits),
        expected=pack(expected, force.width),
        latencies=[(b, f, dut.latency) for f, b in enumerate(last)]
        + [(0, f, dut.latency + fold * b) for f, b in enumerate(last)],
    )


@pytest.mark.parametrize("fold", [2, 4, 8, 16])
@pytest.mark.parametrize("k", [1, 3, 5])
@pytest.mark.parametrize(("axes", "signed"), [(1, False), (3, True)])
@pytest.mark.quick("1-False-1-2", "3-True-3-2", "3-True-3-8", "3-True-3-16", "1-False-5-4", "3-True-1-2")
def test_force_and_map_of_every_frame(fold, k, axes, signed):
    """Without pauses, with pauses on all streams, and with back-pressure from the map alone."""
    n = 5
    rng = np.random.default_rng(k)
    force = extreme_force(n, k, 4, 5, axes, rng, signed)
    q = frames_of(force, rng)[:8:2] if fold > 4 else frames_of(force, rng)
    inputs = pack(beats(q, 1, rng), 5)
    expected = {"o": pack(force(q), force.width), "map": map_beats(force, q, 1)}
    counts = {name: len(payloads) for name, payloads in expected.items()}
    for stalls in (0, {"i": 0.3, "o": 0.8, "map": 0.3}, {"i": 0, "o": 0, "map": 0.7}):
        dut = FoldedPatchForce(force, fold=fold, wants_map=True)
        payloads, taken = run_streams(dut, inputs, counts, stall=stalls)
        assert payloads == expected
        if stalls == 0:
            waits = [t - s for s, t in zip(taken["i"], taken["map"], strict=True)]
            assert waits == [dut.map_latency] * len(waits)
            last = taken["i"][n * n - 1 :: n * n]
            assert [t - s for s, t in zip(last, taken["o"], strict=True)] == [dut.latency] * len(q)
            assert np.diff(taken["o"]).tolist() == [dut.interval] * (len(q) - 1)


@pytest.mark.parametrize("pause", [1, 3, 9, 40])
@pytest.mark.quick("3", "40")
def test_pauses_between_frames(pause):
    """A frame's last patches leave at the pace of the fold, by themselves or with the next frame's beats."""
    rng = np.random.default_rng(pause)
    force = extreme_force(5, 3, 4, 5, 3, rng, signed=True)
    q = frames_of(force, rng)[5:]
    dut = FoldedPatchForce(force, fold=8, wants_map=True)
    expected = {"o": pack(force(q), force.width), "map": map_beats(force, q, 1)}
    counts = {name: len(payloads) for name, payloads in expected.items()}
    stall = {"i": pause / (pause + 1), "o": 0, "map": 0}
    payloads, taken = run_streams(dut, pack(beats(q, 1, rng), 5), counts, stall=stall)
    assert payloads == expected
    assert np.diff(taken["map"]).min() >= dut.fold
    assert taken["o"][-1] - taken["i"][-1] == dut.latency


def test_map_is_built_only_if_wanted():
    force = extreme_force(5, 3, 4, 5, 2, np.random.default_rng(7))

    def parts(**options):
        dut = FoldedPatchForce(force, fold=16, **options)
        return hasattr(dut, "map"), {name for _, name, _ in Fragment.get(dut, None).subfragments}

    assert parts() == (False, {"generator", "products", "accumulator_0"})
    assert parts(wants_map=True) == (True, {"generator", "products", "accumulator_0", "response_0"})


def test_members_are_those_of_one_lane():
    for signed in (False, True):
        force = extreme_force(5, 3, 4, 5, 3, np.random.default_rng(7), signed)
        for wants_map in (False, True):
            whole = PatchForceStream(force, lanes=1, wants_map=wants_map)
            assert FoldedPatchForce(force, fold=8, wants_map=wants_map).signature == whole.signature


def test_latency_and_multipliers_at_full_size():
    """The patches that the last pixel completes, 127 or 254 of them, take `fold` clocks each."""
    small = PatchForce(np.ones((3, 126, 126, 3, 3), np.int64), 8, 8)
    large = PatchForce(np.ones((3, 126, 126, 5, 5), np.int64), 8, 8)
    assert PatchGenerator.reach_of(126, 3, 1) == 127
    found = []
    for force in (small, large):
        for fold in (2, 4, 8, 16):
            dut = FoldedPatchForce(force, fold=fold)
            assert dut.interval == fold * 126**2
            found.append((dut.latency, dut.multipliers))
    assert found == [
        (268, 14), (523, 8), (1033, 5), (2056, 2),
        (523, 38), (1032, 20), (2051, 11), (4090, 5),
    ]  # fmt: skip


def test_invalid_arguments():
    kernel = np.zeros((1, 8, 8, 3, 3), dtype=np.int64)
    with pytest.raises(ValueError, match=r"kernel \(1, 8, 7, 3, 3\): expected \(axes, N, N, K, K\)"):
        FoldedPatchForce(PatchForce(kernel[:, :, :7], 8, 8), fold=4)
    with pytest.raises(ValueError, match="fold 1: expected one of"):
        FoldedPatchForce(PatchForce(kernel, 8, 8), fold=1)
    with pytest.raises(ValueError, match="kernel_size 9: expected one of"):
        FoldedPatchForce(PatchForce(np.zeros((1, 9, 9, 9, 9), dtype=np.int64), 8, 8), fold=4)
