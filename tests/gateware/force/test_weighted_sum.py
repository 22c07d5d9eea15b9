# amaranth: UnusedElaboratable=no
import re
from dataclasses import replace

import numpy as np
import pytest
from amaranth import Const, Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_LATENCY
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.fz_stream import PatchForceStream
from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.gateware.poisson.depth import Displacement
from fastac.gateware.stream.tables import RasterRom
from fastac.models.integer.depth import Depth, DisplacementQuantiser
from fastac.models.integer.force import PatchForce, WeightedSum, terms
from fastac.models.integer.network import GradientRatio
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack


def beats(x, lanes, bits, rng):
    """Frames (F, rows, columns, terms) to payloads; unused lanes are random."""
    fill = rng.integers(0, 1 << bits, (*x.shape[:2], -x.shape[2] % lanes, x.shape[3]))
    return pack(np.concatenate([x, fill], axis=2).reshape(-1, lanes * x.shape[3]), bits)


def weighted_sum(axes, rows, columns, terms, bits, signed, weight_bits, rng):
    """Axis 0 has random weights, axis 1 zeros; with unsigned inputs the last axis has weights of one sign."""
    limit = (1 << (weight_bits - 1)) - 1
    weight = rng.integers(-limit, limit + 1, (axes, rows, columns, terms))
    constant = rng.integers(-limit, 0, axes) << bits
    if axes > 1:
        weight[1] = 0
    if not signed:
        weight[0] //= axes
        weight[-1] = -np.abs(weight[-1])
    return WeightedSum(weight, constant, bits, signed)


def frames_of(weighted, rng):
    """For each axis frames with the largest and the lowest sum, each followed by a random one; then zeros."""
    limit = weighted.input_limit
    low = -limit if weighted.input_signed else 0
    frames = []
    for weight in weighted.weight:
        most = np.where(weight > 0, limit, low)
        for extreme in (most, limit + low - most):
            frames += [extreme, rng.integers(low, limit + 1, weight.shape)]
    return np.stack([*frames, 0 * weight])


@pytest.mark.parametrize(
    ("axes", "rows", "columns", "terms", "lanes", "bits", "signed", "weight_bits"),
    [
        (1, 5, 9, 1, 4, 16, False, 13),
        (3, 6, 8, 2, 4, 17, True, 18),
        (2, 4, 7, 2, 2, 8, True, 6),
        (1, 3, 5, 1, 1, 9, True, 20),
    ],
)
@pytest.mark.quick("3-6-8-2-4-17-True-18")
def test_force_of_every_frame(tmp_path, axes, rows, columns, terms, lanes, bits, signed, weight_bits):
    rng = np.random.default_rng(1)
    weighted = weighted_sum(axes, rows, columns, terms, bits, signed, weight_bits, rng)
    x = frames_of(weighted, rng)
    expected = weighted(x)
    assert np.abs(expected).max() == weighted.bound, "the bound is reached exactly"
    dut = WeightedSumStream(weighted, lanes=lanes)
    assert dut.latency == 6 + (lanes * terms - 1).bit_length()
    assert dut.interval == rows * -(-columns // lanes)
    last = [(f + 1) * dut.interval - 1 for f in range(len(x))]
    check(
        dut,
        "weighted_sum",
        tmp_path,
        inputs=beats(x, lanes, bits, rng),
        expected=pack(expected, weighted.width),
        mask=(1 << axes * weighted.width) - 1,
        places=(dut.interval, RasterRom.latency + PRODUCT_LATENCY),
        latencies=[(b, f, dut.latency) for f, b in enumerate(last)]
        + [(0, f, dut.latency + b) for f, b in enumerate(last)],
    )


def assert_timing(dut, taken):
    """Each force comes `latency` clocks after its last beat, `interval` clocks after the one before."""
    last = taken["i"][dut.interval - 1 :: dut.interval]
    assert [t - s for s, t in zip(last, taken["o"], strict=True)] == [dut.latency] * len(last)
    assert np.diff(taken["o"]).tolist() == [dut.interval] * (len(last) - 1)


@pytest.mark.parametrize("columns", [6, 7])
@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.parametrize("terms", [1, 2])
@pytest.mark.parametrize(("axes", "signed"), [(1, False), (1, True), (2, True), (3, False), (3, True)])
@pytest.mark.quick(
    "1-False-1-1-6",
    "1-False-2-2-7",
    "1-True-1-4-7",
    "2-True-2-4-6",
    "3-False-1-2-6",
    "3-False-2-1-7",
    "1-True-2-1-6",
    "2-True-1-1-7",
    "3-True-1-1-6",
    "3-True-2-2-7",
    "1-False-1-4-6",
    "1-True-1-2-6",
    "2-True-1-2-6",
    "3-False-1-4-6",
    "3-True-1-4-6",
)
def test_every_shape_with_stalls(columns, lanes, terms, axes, signed):
    rng = np.random.default_rng(columns)
    weighted = weighted_sum(axes, 3, columns, terms, 6, signed, 5, rng)
    x = frames_of(weighted, rng)
    expected = weighted(x)
    assert np.abs(expected).max() == weighted.bound
    inputs = beats(x, lanes, 6, rng)
    for stall in (0, 0.4):
        dut = WeightedSumStream(weighted, lanes=lanes)
        payloads, taken = run_streams(dut, inputs, {"o": len(x)}, stall=stall)
        assert payloads["o"] == pack(expected, weighted.width)
        if not stall:
            assert_timing(dut, taken)


def test_back_pressure_stalls_without_loss():
    rng = np.random.default_rng(3)
    weighted = weighted_sum(1, 2, 4, 2, 6, True, 5, rng)
    x = rng.integers(-31, 32, (12, 2, 4, 2))
    dut = WeightedSumStream(weighted, lanes=2)
    payloads, taken = run_streams(dut, beats(x, 2, 6, rng), {"o": len(x)}, stall={"i": 0, "o": 0.98})
    assert payloads["o"] == pack(weighted(x), weighted.width)
    waiting = [sum(t < clock for t in taken["i"]) - k * dut.interval for k, clock in enumerate(taken["o"])]
    assert max(waiting) == dut.interval + dut.latency - 1, "every place fills while a result waits"


class WithConstant(wiring.Component):
    """`component` with its streams, and `constant` (axes,) at its port of that name."""

    def __init__(self, component, constant):
        self.component, self.constant = component, constant
        super().__init__({"i": In(component.i.signature.flip()), "o": Out(component.o.signature)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.component = component = self.component
        wiring.connect(m, wiring.flipped(self.i), component.i)
        wiring.connect(m, component.o, wiring.flipped(self.o))
        [image] = pack([self.constant], component.weighted.width)
        m.d.comb += component.constant.as_value().eq(Const(image, len(component.constant.as_value())))
        return m


@pytest.mark.parametrize("lanes", [1, 2])
@pytest.mark.quick("2")
def test_loadable_constant_replaces_the_built_in_one(lanes):
    rng = np.random.default_rng(6)
    start = weighted_sum(3, 3, 4, 2, 6, True, 5, rng)
    weighted = replace(start, constant=start.constant[::-1] // 2 + np.array([1, -1, 0]))
    assert weighted.width == start.width
    x = rng.integers(-31, 32, (4, 3, 4, 2))
    dut = WeightedSumStream(start, lanes=lanes, loadable=True)
    assert "constant" not in WeightedSumStream(start, lanes=lanes).signature.members
    inputs = beats(x, lanes, 6, rng)
    payloads, _ = run_streams(WithConstant(dut, weighted.constant), inputs, {"o": len(x)}, stall=0.3)
    assert payloads["o"] == pack(weighted(x), weighted.width) != pack(start(x), start.width)


def test_zero_weights_give_the_constant():
    weighted = WeightedSum(np.zeros((2, 4, 5, 1), int), np.array([-77, 12]), 8, False)
    assert weighted.bound == 77
    dut = WeightedSumStream(weighted, lanes=2)
    payloads, _ = run_streams(dut, [0xFFFF] * 24, {"o": 2})
    assert payloads["o"] == pack([[-77, 12]] * 2, weighted.width)


BENDS = [(0,), (1,), (9,), (30,), (31,), (0, 1), (1, 30), (9, 20), (5, 31), (2, 8, 16, 27)]


def bent_sum(axes, columns, bits, rng, *, bends=1):
    """A sum of displacements with a band and, of further bends, with what is deeper than each. At each pixel
    the first axis has weights on one side alone, there of the sign with which all pixels and the constant add
    up."""
    limit = 15
    weight = rng.integers(-limit, limit + 1, (axes, 3, columns, 2 + bends))
    side = rng.integers(1, 3, weight.shape[1:3])
    weight[0] = np.abs(weight[0]) * np.where(side == 1, -1, 1)[..., None]
    weight[0, ..., 1:] *= np.stack([side == 1, side == 2, *[side == 1] * (bends - 1)], axis=-1)
    weight[1:] = np.clip(weight[1:] // 2, -limit // (2 * axes), limit // (2 * axes))
    return WeightedSum(weight, rng.integers(-limit, 1, axes) << bits, bits, True)


def displacements(weighted, bends, rng, *, count=4):
    """Frames of each value about the edges, of all of them mixed, `count` random ones, and those of either
    sign that give the first axis its largest and its lowest sum."""
    limit = weighted.input_limit
    shape = weighted.weight.shape[1:3]
    edges = {0, 1, -1, limit, -limit}
    near = {bend + step for bend in bends for step in (-1, 0, 1)}
    edges |= {sign * value for sign in (1, -1) for value in near if abs(value) <= limit}
    values = np.array([-limit, limit])
    reached = terms(values, bends) @ weighted.weight[0].reshape(-1, 2 + len(bends)).T  # (2, pixels)
    most, least = (values[choice(reached, axis=0)].reshape(shape) for choice in (np.argmax, np.argmin))
    mixed = [rng.choice(sorted(edges), shape) for _ in range(4)]
    random = list(rng.integers(-limit, limit + 1, (count, *shape)))
    return np.stack([most, least, *(np.full(shape, value) for value in sorted(edges)), *mixed, *random])


@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.parametrize("bends", BENDS, ids=lambda bends: "/".join(map(str, bends)))
@pytest.mark.quick("0-4", "9-4", "1-1", "30-2", "31-1", "9/20-4", "0/1-2", "5/31-1", "2/8/16/27-4")
def test_bends(lanes, bends):
    """What is beyond the band on either side, and what is deep, has weights of its own. A single product does
    for all of them."""
    band = bends[0]
    rng = np.random.default_rng(10 * lanes + sum(bends))
    weighted = bent_sum(2, 7, 6, rng, bends=len(bends))
    x = displacements(weighted, bends, rng)
    expected = weighted(terms(x, bends))
    inputs = beats(x[..., None], lanes, 6, rng)
    largest = np.abs(expected).max()
    beyond = weighted.input_limit - np.array([0, band, *bends])
    assert largest == abs(weighted.constant[0]) + (np.abs(weighted.weight[0]) * beyond).sum()
    # What is beyond a bend is less than the limit, which the bound takes for it.
    assert (largest == weighted.bound) == (bends == (0,)), "the bound is reached"
    for stall in (0, 0.4):
        dut = WeightedSumStream(weighted, lanes=lanes, bends=bends)
        assert dut.latency == 6 + (lanes - 1).bit_length()
        assert dut.multipliers == 2 * lanes
        payloads, taken = run_streams(dut, inputs, {"o": len(x)}, stall=stall)
        assert payloads["o"] == pack(expected, weighted.width)
        if not stall:
            assert_timing(dut, taken)


SQUARES = [(2, 0), (2, 1), (4, 0), (4, 3), (8, 5)]


def in_squares(weighted, block_px, cut_rows):
    """The sum with the weights of each square's first pixel for all of its pixels."""
    rows, columns = weighted.weight.shape[1:3]
    first_row = np.maximum((np.arange(rows) + cut_rows) // block_px * block_px - cut_rows, 0)
    first_column = np.arange(columns) // block_px * block_px
    weight = weighted.weight[:, first_row][:, :, first_column]
    return replace(weighted, weight=weight, block_px=block_px, cut_rows=cut_rows)


@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.parametrize(("block_px", "cut_rows"), SQUARES)
@pytest.mark.quick("2-1-4", "4-0-4", "4-3-1", "8-5-2", "2-0-2")
def test_squares_of_pixels_that_share_their_weights(lanes, block_px, cut_rows):
    """The sum and its timing are those of the same weights pixel by pixel; the ROM has a word a square."""
    rng = np.random.default_rng(lanes)
    weighted = in_squares(weighted_sum(2, 5, 7, 2, 6, True, 5, rng), block_px, cut_rows)
    x = frames_of(weighted, rng)
    expected = weighted(x)
    assert np.abs(expected).max() == weighted.bound
    inputs = beats(x, lanes, 6, rng)
    for stall in (0, 0.4):
        dut = WeightedSumStream(weighted, lanes=lanes)
        plain = WeightedSumStream(replace(weighted, block_px=1, cut_rows=0), lanes=lanes)
        assert (dut.latency, dut.interval, dut.multipliers) == (
            plain.latency,
            plain.interval,
            plain.multipliers,
        )
        payloads, taken = run_streams(dut, inputs, {"o": len(x)}, stall=stall)
        assert payloads["o"] == pack(expected, weighted.width)
        if not stall:
            assert_timing(dut, taken)


@pytest.mark.parametrize("lanes", [1, 4])
def test_squares_with_bends(lanes):
    rng, bends = np.random.default_rng(lanes), (9, 20)
    weighted = in_squares(bent_sum(2, 7, 6, rng, bends=2), 4, 1)
    x = displacements(weighted, bends, rng)
    dut = WeightedSumStream(weighted, lanes=lanes, bends=bends)
    payloads, _ = run_streams(dut, beats(x[..., None], lanes, 6, rng), {"o": len(x)}, stall=0.3)
    assert payloads["o"] == pack(weighted(terms(x, bends)), weighted.width)


@pytest.mark.parametrize("lanes", [4, 1])
@pytest.mark.quick("4")
def test_bends_in_verilator(tmp_path, lanes):
    rng = np.random.default_rng(lanes)
    weighted, bends = bent_sum(3, 14, 8, rng, bends=2), (21, 60)
    x = displacements(weighted, bends, rng, count=16)
    dut = WeightedSumStream(weighted, lanes=lanes, bends=bends)
    check(
        dut,
        "weighted_sum_bends",
        tmp_path,
        inputs=beats(x[..., None], lanes, 8, rng),
        expected=pack(weighted(terms(x, bends)), weighted.width),
        latencies=[((f + 1) * dut.interval - 1, f, dut.latency) for f in range(len(x))],
        places=(dut.interval, RasterRom.latency + PRODUCT_LATENCY),
    )


def test_wrong_use_of_bends():
    for count, signed, bends in ((3, False, (5,)), (1, True, (5,)), (2, True, (5,)), (3, True, (5, 9))):
        weighted = WeightedSum(np.ones((1, 4, 4, count), int), np.zeros(1, int), 8, signed)
        message = f"bends {bends}: {count} terms: expected {2 + len(bends)} of a signed value"
        with pytest.raises(ValueError, match=re.escape(message)):
            WeightedSumStream(weighted, lanes=2, bends=bends)


@pytest.mark.parametrize(("k", "lanes", "signed"), [(1, 4, False), (3, 1, True), (5, 2, False), (7, 4, True)])
@pytest.mark.quick("3-1-True", "5-2-False")
def test_collapsed_kernels_give_the_patches_force(k, lanes, signed):
    """PatchForceStream and WeightedSumStream agree on saturated frames, single corners and random frames."""
    rng = np.random.default_rng(k)
    n, bits = 8, 6
    force = PatchForce(rng.integers(-8, 8, (2, n, n, k, k)), 4, bits, signed)
    top = force.displacement_limit
    q = rng.integers(-top if signed else 0, top + 1, (8, n, n))
    q[0], q[1:5] = top, 0
    for frame, corner in enumerate([(0, 0), (0, -1), (-1, 0), (-1, -1)], start=1):
        q[(frame, *corner)] = top
    q[5] *= -1 if signed else 1
    weighted = force.collapsed()
    patches, sums = PatchForceStream(force, lanes=lanes), WeightedSumStream(weighted, lanes=lanes)
    assert patches.i.payload.shape() == sums.i.payload.shape()
    assert sums.latency < patches.latency
    assert sums.multipliers * k * k == patches.multipliers
    inputs = beats(q[..., None], lanes, bits, rng)
    expected = force(q)
    by_patches, _ = run_streams(patches, inputs, {"o": len(q)})
    by_weights, _ = run_streams(sums, inputs, {"o": len(q)})
    assert by_patches["o"] == pack(expected, force.width)
    assert by_weights["o"] == pack(expected, weighted.width)


@pytest.mark.parametrize("clamp", [True, False])
def test_connects_to_displacements_and_slopes(clamp):
    depth = Depth("difference", 12, np.zeros((6, 6), int))
    quantiser = DisplacementQuantiser(depth.width, 2, 8, clamp)
    displaced = WeightedSum(np.ones((1, 6, 6, 1), int), np.zeros(1, int), 8, not clamp)
    dut = WeightedSumStream(displaced, lanes=2)
    assert Displacement(depth, quantiser, lanes=2).o.payload.shape() == dut.i.payload.shape()
    if not clamp:
        banded = WeightedSum(np.ones((1, 6, 6, 3), int), np.zeros(1, int), 8, True)
        assert WeightedSumStream(banded, lanes=2, bends=(3,)).i.payload.shape() == dut.i.payload.shape()
    sloped = WeightedSum(np.ones((1, 6, 8, 2), int), np.zeros(1, int), 10, True)
    divider = GradientDivider(GradientRatio(12, 10, 6), lanes=4)
    assert divider.o.payload.shape() == WeightedSumStream(sloped, lanes=4).i.payload.shape()


def test_latency_and_multipliers_at_full_size():
    """128×128 slopes, 4 per clock, three axes: 9 clocks from the last slope to the force, 24 multipliers."""
    weight = np.full((3, 128, 128, 2), 1 << 16)
    dut = WeightedSumStream(WeightedSum(weight, np.zeros(3, int), 17, True), lanes=4)
    assert (dut.latency, dut.interval, dut.multipliers) == (9, 4096, 24)
    wide = WeightedSum(weight * 4, np.zeros(3, int), 17, True)  # 20-bit weights go to the 27-bit port
    assert WeightedSumStream(wide, lanes=4).multipliers == 24
    assert WeightedSumStream(WeightedSum(weight * 4, np.zeros(3, int), 19, True), lanes=4).multipliers == 48


def test_invalid_arguments():
    weighted = WeightedSum(np.ones((1, 4, 4, 1), int), np.zeros(1, int), 8, False)
    with pytest.raises(ValueError, match="lanes 3: expected one of"):
        WeightedSumStream(weighted, lanes=3)
    pixel = WeightedSum(np.ones((1, 1, 4, 1), int), np.zeros(1, int), 8, False)
    with pytest.raises(ValueError, match="frame of 1×4: expected at least 2 beats"):
        WeightedSumStream(pixel, lanes=4)
