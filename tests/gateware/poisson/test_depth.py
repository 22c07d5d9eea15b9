# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Shape
from amaranth.sim import Simulator

from fastac.gateware.poisson.depth import DepthOutput, Displacement
from fastac.models.integer.depth import Depth, DisplacementQuantiser
from fastac.sim.check_stream import check, pack
from fastac.sim.preloaded import PreloadedTable

FRAMES = 3


def solutions(n, width, rng):
    """Frames of solutions: all lowest, all highest, then random."""
    limit = 1 << (width - 1)
    z = rng.integers(-limit, limit, (FRAMES, n, n))
    z[0], z[1] = -limit, limit - 1
    return z


def beats(frames, lanes, rng=None):
    """Frames (F, N, N) to beats (F·N·ceil(N/lanes), lanes); unused lanes are 0, or random with `rng`."""
    n = frames.shape[-1]
    fill = np.zeros((*frames.shape[:-1], -n % lanes), dtype=np.int64)
    if rng is not None:
        fill = rng.integers(-(1 << 40), 1 << 40, fill.shape)
    return np.concatenate([frames, fill], axis=-1).reshape(-1, lanes)


def masks(n, lanes, bits, frames=FRAMES):
    return pack(beats(np.full((frames, n, n), -1), lanes), bits)


@pytest.mark.parametrize(
    ("mode", "n", "lanes", "width", "shift", "bits", "clamp"),
    [
        ("absolute", 10, 4, 16, 5, 8, True),
        ("absolute", 9, 2, 12, 0, 6, True),
        ("difference", 8, 1, 18, 9, 8, True),
        ("absolute", 9, 4, 16, 5, 8, False),
        ("difference", 8, 2, 18, 9, 8, False),
    ],
)
@pytest.mark.quick("difference-8-2-18-9-8-False", mutate=["absolute-10-4-16-5-8-True"])
def test_displacement_bit_exact_to_golden_model(tmp_path, mode, n, lanes, width, shift, bits, clamp):
    rng = np.random.default_rng(1)
    rest = rng.integers(-(1 << width), 1 << width, (n, n))
    depth = Depth(mode, width, rest)
    quantiser = DisplacementQuantiser(depth.width, shift, bits, clamp)
    dut = Displacement(depth, quantiser, lanes=lanes)
    assert dut.o.payload.shape().elem_shape == Shape(bits, signed=not clamp)
    z = solutions(n, width, rng)
    # Frames at and near the rounding and clipping thresholds, as far as the mode can reach them: each bit of
    # a solution moves one of these values across.
    edges = np.array([0, 1, quantiser.top, quantiser.top + 1]) << shift
    if not clamp:
        edges = np.concatenate([-edges, edges])
    steps = 1 << np.arange(shift + 1)
    steps = np.concatenate([[0], steps, -steps])
    near = rng.choice(edges, (3, n, n)) - (1 << shift >> 1) + rng.choice(steps, (3, n, n))
    z = np.concatenate([z, np.clip((rest if dut.has_rom else 0) - near, z.min(), z.max())])
    q, saturated = quantiser(depth(z)[1])
    assert saturated.any()
    assert not saturated.all()
    assert q.max() == quantiser.top
    assert q.min() == (0 if clamp else -quantiser.top)
    expected = beats(q, lanes)
    check(
        dut,
        "displacement",
        tmp_path,
        elastic=True,
        inputs=pack(beats(z, lanes, rng), width),
        expected=pack(expected, bits),
        mask=masks(n, lanes, bits, len(z)),
        latencies=[(k, k, dut.latency) for k in range(len(expected))],
        flags={"saturated": int(beats(saturated, lanes).any(axis=-1).sum())},
    )


@pytest.mark.parametrize(
    ("mode", "n", "lanes", "skin", "latency"),
    [("difference", 11, 4, 1 << 14, 3), ("absolute", 9, 2, 1 << 14, 1)],
)
@pytest.mark.quick("difference-11-4-16384-3")
def test_depth_bit_exact_to_golden_model(tmp_path, mode, n, lanes, skin, latency):
    rng = np.random.default_rng(2)
    depth = Depth(mode, 14, rng.integers(-skin, skin + 1, (n, n)))
    dut = DepthOutput(depth, lanes=lanes)
    assert dut.latency == latency
    z = solutions(n, 14, rng)
    expected = beats(depth(z)[0], lanes)
    check(
        dut,
        "depth_output",
        tmp_path,
        elastic=True,
        inputs=pack(beats(z, lanes, rng), 14),
        expected=pack(expected, depth.width),
        mask=masks(n, lanes, depth.width),
        latencies=[(k, k, latency) for k in range(len(expected))],
    )


@pytest.mark.parametrize(("n", "lanes", "width", "shift"), [(9, 2, 12, 5), (5, 1, 12, 0)])
@pytest.mark.quick("9-2-12-5")
def test_loaded_rest(tmp_path, n, lanes, width, shift):
    """Hardware built with a rest of zeros computes with the largest rest that its format can hold."""
    rng = np.random.default_rng(4)
    largest = (1 << (width - 1)) - 1
    rest = rng.integers(-largest, largest + 1, (n, n))
    rest[0, :2] = largest, -largest
    depth, start = Depth("absolute", width, rest), Depth("absolute", width, np.zeros((n, n), dtype=int))
    assert depth.width == start.width
    quantiser = DisplacementQuantiser(depth.width, shift, 8)
    dut, loaded = (Displacement(d, quantiser, lanes=lanes, loadable=True) for d in (start, depth))
    assert dut.table == loaded.table == (n * -(-n // lanes), lanes, depth.width)
    z = solutions(n, width, rng)
    q, saturated = quantiser(depth(z)[1])
    check(
        PreloadedTable(dut, "rest", loaded.table_values, dut.table.bits, flags=("saturated",)),
        "displacement",
        tmp_path,
        inputs=pack(beats(z, lanes, rng), width),
        expected=pack(beats(q, lanes), 8),
        mask=masks(n, lanes, 8),
        flags={"saturated": int(beats(saturated, lanes).any(axis=-1).sum())},
    )


def test_only_a_loadable_rest_can_be_written():
    curved = np.ones((8, 8), dtype=int)
    for mode, loadable in (("absolute", True), ("absolute", False), ("difference", True)):
        depth = Depth(mode, 9, curved)
        quantiser = DisplacementQuantiser(depth.width, 0, 8)
        dut = Displacement(depth, quantiser, lanes=1, loadable=loadable)
        assert ("rest" in dut.signature.members) == (mode == "absolute" and loadable)


def test_rest_rom_exists_only_in_modes_that_add_it():
    flat, curved = np.zeros((8, 8), dtype=int), np.ones((8, 8), dtype=int)
    assert DepthOutput(Depth("difference", 9, curved), lanes=1).has_rom
    assert not DepthOutput(Depth("difference", 9, flat), lanes=1).has_rom
    assert not DepthOutput(Depth("absolute", 9, curved), lanes=1).has_rom
    for mode in ("absolute", "difference"):
        depth = Depth(mode, 9, curved)
        dut = Displacement(depth, DisplacementQuantiser(depth.width, 0, 8), lanes=1)
        assert dut.has_rom == (mode == "absolute")


@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.parametrize("shift", [0, 3])
@pytest.mark.quick("0-1", "3-4")
def test_every_signed_displacement(lanes, shift):
    """Every solution of a small format, and `saturated` in every beat in which a displacement saturates."""
    n, width, bits = 16, 8, 4
    depth = Depth("difference", width, np.zeros((n, n), dtype=int))
    quantiser = DisplacementQuantiser(depth.width, shift, bits, clamp=False)
    z = np.arange(-128, 128).reshape(1, n, n)
    q, saturated = quantiser(depth(z)[1])
    dut = Displacement(depth, quantiser, lanes=lanes)

    async def bench(ctx):
        ctx.set(dut.o.ready, 1)
        words, flagged = [], []
        for payload in [*pack(beats(z, lanes), width), *[None] * dut.latency]:
            ctx.set(dut.i.valid, payload is not None)
            ctx.set(dut.i.payload.as_value(), payload or 0)
            *_, valid, word, flag = await ctx.tick().sample(dut.o.valid, dut.o.payload, dut.saturated)
            if valid:
                words.append([word[lane] for lane in range(lanes)])
                flagged.append(flag)
        assert words == beats(q, lanes).tolist()
        assert flagged == beats(saturated, lanes).any(axis=-1).tolist()

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()


def test_invalid_arguments():
    depth = Depth("absolute", 10, np.ones((8, 8), dtype=int))
    quantiser = DisplacementQuantiser(depth.width, 2, 8)
    with pytest.raises(ValueError, match="lanes 3: expected one of"):
        Displacement(depth, quantiser, lanes=3)
    with pytest.raises(ValueError, match=r"quantiser.input_width 9: expected 11"):
        Displacement(depth, DisplacementQuantiser(9, 2, 8), lanes=1)
    with pytest.raises(ValueError, match=r"rest \(8, 9\): expected square"):
        DepthOutput(Depth("absolute", 10, np.ones((8, 9), dtype=int)), lanes=1)
