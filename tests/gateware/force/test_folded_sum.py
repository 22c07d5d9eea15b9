# amaranth: UnusedElaboratable=no
import re
from dataclasses import replace

import numpy as np
import pytest

from fastac.gateware.force.folded_sum import FoldedWeightedSum
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.models.integer.force import PatchForce, WeightedSum, terms
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack
from tests.gateware.force.test_weighted_sum import (
    SQUARES,
    WithConstant,
    beats,
    bent_sum,
    displacements,
    frames_of,
    in_squares,
    weighted_sum,
)

FOLDS = [2, 4, 8, 16]


def assert_timing(dut, taken):
    """A beat is taken every `fold` clocks, and each force comes `latency` clocks after its last one."""
    pixels = dut.rows * dut.columns
    assert set(np.diff(taken["i"])) == {dut.fold}
    last = taken["i"][pixels - 1 :: pixels]
    assert [t - s for s, t in zip(last, taken["o"], strict=True)] == [dut.latency] * len(last)
    assert np.diff(taken["o"]).tolist() == [dut.interval] * (len(last) - 1)


@pytest.mark.parametrize(
    ("fold", "axes", "terms", "bits", "signed", "weight_bits"),
    [(16, 3, 2, 17, True, 16), (2, 3, 2, 9, True, 7), (4, 1, 1, 8, False, 13), (8, 1, 2, 6, False, 5)],
)
@pytest.mark.quick("16-3-2-17-True-16", mutate=["2-3-2-9-True-7"])
def test_force_of_every_frame(tmp_path, fold, axes, terms, bits, signed, weight_bits):
    rng = np.random.default_rng(1)
    weighted = weighted_sum(axes, 3, 5, terms, bits, signed, weight_bits, rng)
    x = frames_of(weighted, rng)
    expected = weighted(x)
    assert np.abs(expected).max() == weighted.bound, "the bound is reached exactly"
    dut = FoldedWeightedSum(weighted, fold=fold)
    last = [15 * (f + 1) - 1 for f in range(len(x))]
    check(
        dut,
        "folded_weighted_sum",
        tmp_path,
        inputs=beats(x, 1, bits, rng),
        expected=pack(expected, weighted.width),
        latencies=[(b, f, dut.latency) for f, b in enumerate(last)]
        + [(0, f, dut.latency + fold * b) for f, b in enumerate(last)],
        places=(15, 0),
    )


@pytest.mark.parametrize("fold", FOLDS)
@pytest.mark.parametrize("terms", [1, 2])
@pytest.mark.parametrize(("axes", "signed"), [(1, False), (2, True), (3, False), (3, True)])
@pytest.mark.quick(
    "1-False-1-2", "2-True-2-4", "3-True-2-16", "3-False-1-2", "3-False-2-8", "3-True-1-4", "3-False-2-4"
)
def test_every_shape_with_stalls(fold, terms, axes, signed):
    rng = np.random.default_rng(fold)
    weighted = weighted_sum(axes, 2, 3, terms, 6, signed, 5, rng)
    x = frames_of(weighted, rng)
    expected = weighted(x)
    assert np.abs(expected).max() == weighted.bound
    inputs = beats(x, 1, 6, rng)
    for stall in (0, 0.4, {"i": 0, "o": 0.9}):
        dut = FoldedWeightedSum(weighted, fold=fold)
        assert dut.multipliers == -(-axes * terms // fold)
        assert dut.latency <= fold + 7
        payloads, taken = run_streams(dut, inputs, {"o": len(x)}, stall=stall)
        assert payloads["o"] == pack(expected, weighted.width)
        if stall == 0:
            assert_timing(dut, taken)


def test_pixels_that_come_more_slowly_than_the_fold():
    rng = np.random.default_rng(4)
    weighted = weighted_sum(3, 2, 4, 2, 6, True, 5, rng)
    x = rng.integers(-31, 32, (4, 2, 4, 2))
    dut = FoldedWeightedSum(weighted, fold=8)
    payloads, taken = run_streams(dut, beats(x, 1, 6, rng), {"o": 4}, stall={"i": 0.97, "o": 0})
    assert payloads["o"] == pack(weighted(x), weighted.width)
    assert np.diff(taken["i"]).max() > 2 * dut.fold
    assert [t - s for s, t in zip(taken["i"][7::8], taken["o"], strict=True)] == [dut.latency] * 4


@pytest.mark.parametrize("fold", [2, 16])
@pytest.mark.quick("2", "16")
def test_loadable_constant_replaces_the_built_in_one(fold):
    rng = np.random.default_rng(6)
    start = weighted_sum(3, 2, 3, 2, 6, True, 5, rng)
    weighted = replace(start, constant=start.constant[::-1] // 2 + np.array([1, -1, 0]))
    assert weighted.width == start.width
    x = rng.integers(-31, 32, (4, 2, 3, 2))
    dut = FoldedWeightedSum(start, fold=fold, loadable=True)
    assert "constant" not in FoldedWeightedSum(start, fold=fold).signature.members
    inputs = beats(x, 1, 6, rng)
    payloads, _ = run_streams(WithConstant(dut, weighted.constant), inputs, {"o": len(x)}, stall=0.3)
    assert payloads["o"] == pack(weighted(x), weighted.width) != pack(start(x), start.width)


def test_zero_weights_give_the_constant():
    weighted = WeightedSum(np.zeros((2, 2, 3, 1), int), np.array([-77, 12]), 8, False)
    dut = FoldedWeightedSum(weighted, fold=4)
    payloads, _ = run_streams(dut, [0xFF] * 12, {"o": 2})
    assert payloads["o"] == pack([[-77, 12]] * 2, weighted.width)


@pytest.mark.parametrize("fold", FOLDS)
@pytest.mark.parametrize(
    "bends",
    [(0,), (9,), (31,), (0, 1), (9, 20), (5, 31), (4, 9, 28)],
    ids=lambda bends: "/".join(map(str, bends)),
)
@pytest.mark.quick("0-2", "9-16", "9/20-4", "5/31-2", "0/1-8", "9/20-16")
def test_bends(fold, bends):
    """Of what is beyond the band the pixel's sign chooses the weight; a product is spared."""
    rng = np.random.default_rng(10 * fold + sum(bends))
    axes = 1 if fold == 2 else 3
    weighted = bent_sum(axes, 3, 6, rng, bends=len(bends))
    x = displacements(weighted, bends, rng, count=2)
    expected = weighted(terms(x, bends))
    beyond = weighted.input_limit - np.array([0, bends[0], *bends])
    most = abs(weighted.constant[0]) + (np.abs(weighted.weight[0]) * beyond).sum()
    assert np.abs(expected[:, 0]).max() == most
    inputs = beats(x[..., None], 1, 6, rng)
    for stall in (0, 0.4):
        dut = FoldedWeightedSum(weighted, fold=fold, bends=bends)
        assert dut.multipliers == -(-axes * (1 + len(bends)) // fold)
        payloads, taken = run_streams(dut, inputs, {"o": len(x)}, stall=stall)
        assert payloads["o"] == pack(expected, weighted.width)
        if not stall:
            assert_timing(dut, taken)


@pytest.mark.parametrize(("block_px", "cut_rows"), SQUARES)
@pytest.mark.parametrize("bends", [(), (9, 20)], ids=["", "bends"])
@pytest.mark.quick("-4-0", "-4-3", "-8-5", "bends-2-1")
def test_squares_of_pixels_that_share_their_weights(block_px, cut_rows, bends):
    rng = np.random.default_rng(block_px)
    if bends:
        weighted = in_squares(bent_sum(3, 7, 6, rng, bends=2), block_px, cut_rows)
        given = displacements(weighted, bends, rng, count=2)
        x, expected = given[..., None], weighted(terms(given, bends))
    else:
        weighted = in_squares(weighted_sum(3, 5, 7, 2, 6, True, 5, rng), block_px, cut_rows)
        x = frames_of(weighted, rng)
        expected = weighted(x)
    for stall in (0, 0.4):
        dut = FoldedWeightedSum(weighted, fold=4, bends=bends)
        payloads, taken = run_streams(dut, beats(x, 1, 6, rng), {"o": len(x)}, stall=stall)
        assert payloads["o"] == pack(expected, weighted.width)
        if not stall:
            assert_timing(dut, taken)


def test_bends_in_verilator(tmp_path):
    rng = np.random.default_rng(1)
    weighted, bends = bent_sum(3, 3, 8, rng, bends=2), (21, 60)
    x = displacements(weighted, bends, rng, count=4)
    dut = FoldedWeightedSum(weighted, fold=4, bends=bends)
    check(
        dut,
        "folded_weighted_sum_bends",
        tmp_path,
        inputs=beats(x[..., None], 1, 8, rng),
        expected=pack(weighted(terms(x, bends)), weighted.width),
        latencies=[(9 * f + 8, f, dut.latency) for f in range(len(x))],
        places=(9, 0),
    )


def test_members_are_those_of_one_lane():
    rng = np.random.default_rng(8)
    for axes, count, signed in ((3, 2, True), (1, 1, False)):
        weighted = weighted_sum(axes, 2, 3, count, 6, signed, 5, rng)
        folded, whole = FoldedWeightedSum(weighted, fold=4), WeightedSumStream(weighted, lanes=1)
        assert folded.signature == whole.signature
    banded = bent_sum(2, 3, 6, rng)
    folded = FoldedWeightedSum(banded, fold=4, bends=(9,), loadable=True)
    assert folded.signature == WeightedSumStream(banded, lanes=1, bends=(9,), loadable=True).signature
    collapsed = PatchForce(np.ones((1, 5, 5, 3, 3), int), 4, 5).collapsed()
    assert FoldedWeightedSum(collapsed, fold=2).multipliers == 1


def test_latency_and_multipliers_at_full_size():
    """128×128 slopes, 16 clocks each, three axes: 11 clocks from the last one to the force, 1 multiplier."""
    weight = np.full((3, 128, 128, 2), 1 << 15)
    slopes = WeightedSum(weight, np.zeros(3, int), 17, True)
    found = []
    for fold in FOLDS:
        dut = FoldedWeightedSum(slopes, fold=fold)
        assert dut.interval == fold * 16_384
        found.append((dut.latency, dut.multipliers))
    assert found == [(8, 3), (9, 2), (11, 1), (11, 1)]
    wide = WeightedSum(weight * 8, np.zeros(3, int), 19, True)  # 20 × 19 bits take two DSP slices
    assert FoldedWeightedSum(wide, fold=16).multipliers == 2


def test_invalid_arguments():
    weighted = WeightedSum(np.ones((1, 4, 4, 1), int), np.zeros(1, int), 8, False)
    for fold in (1, 3, 32):
        with pytest.raises(ValueError, match=re.escape(f"fold {fold}: expected one of (2, 4, 8, 16)")):
            FoldedWeightedSum(weighted, fold=fold)
    pixel = WeightedSum(np.ones((1, 1, 1, 1), int), np.zeros(1, int), 8, False)
    with pytest.raises(ValueError, match="frame of 1×1: expected at least 2 pixels"):
        FoldedWeightedSum(pixel, fold=4)
    with pytest.raises(ValueError, match=re.escape("bends (5,): 1 terms: expected 3 of a signed value")):
        FoldedWeightedSum(weighted, fold=4, bends=(5,))
