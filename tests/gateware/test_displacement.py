# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from gateware.displacement import DepthOutput, Displacement, RasterRom, raster_beats
from models.integer import Depth, DisplacementQuantiser
from sim.stream import check, pack

FRAMES = 3


def solutions(n, width, rng):
    """Frames of solutions, extremes first: the lowest, the highest, then anything."""
    limit = 1 << (width - 1)
    z = rng.integers(-limit, limit, (FRAMES, n, n))
    z[0], z[1] = -limit, limit - 1
    return z


def beats(frames, lanes, rng=None):
    """Frames (F, N, N) to beats (F·N·ceil(N/lanes), lanes); void lanes are random where `rng` is given."""
    n = frames.shape[-1]
    fill = np.zeros((*frames.shape[:-1], -n % lanes), dtype=np.int64)
    if rng is not None:
        fill = rng.integers(-(1 << 40), 1 << 40, fill.shape)
    return np.concatenate([frames, fill], axis=-1).reshape(-1, lanes)


def masks(n, lanes, bits, frames=FRAMES):
    return pack(beats(np.full((frames, n, n), -1), lanes), bits)


@pytest.mark.parametrize(
    ("mode", "n", "lanes", "width", "shift", "bits"),
    [
        ("absolute", 10, 4, 16, 5, 8),
        ("absolute", 9, 2, 12, 0, 6),
        ("difference", 8, 1, 18, 9, 8),
    ],
)
def test_displacement_equals_reference(tmp_path, mode, n, lanes, width, shift, bits):
    rng = np.random.default_rng(1)
    rest = rng.integers(-(1 << width), 1 << width, (n, n))
    depth = Depth(mode, width, rest)
    quantiser = DisplacementQuantiser(depth.width, shift, bits)
    dut = Displacement(depth, quantiser, lanes=lanes)
    z = solutions(n, width, rng)
    # One frame around the rounding and clipping thresholds, as far as the mode can reach them.
    edges = np.array([0, 1, 2**bits - 1, 2**bits]) << shift
    near = rng.choice(edges, (n, n)) - (1 << shift >> 1) + rng.integers(-1, 2, (n, n))
    z = np.concatenate([z, [np.clip((rest if dut.has_rom else 0) - near, z.min(), z.max())]])
    q, saturated = quantiser(depth(z)[1])
    assert saturated.any()
    assert not saturated.all()
    expected = beats(q, lanes)
    check(
        dut,
        "displacement",
        tmp_path,
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
def test_depth_equals_reference(tmp_path, mode, n, lanes, skin, latency):
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
        inputs=pack(beats(z, lanes, rng), 14),
        expected=pack(expected, depth.width),
        mask=masks(n, lanes, depth.width),
        latencies=[(k, k, latency) for k in range(len(expected))],
    )


def test_only_a_mode_that_adds_rest_has_its_table():
    flat, curved = np.zeros((8, 8), dtype=int), np.ones((8, 8), dtype=int)
    assert DepthOutput(Depth("difference", 9, curved), lanes=1).has_rom
    assert not DepthOutput(Depth("difference", 9, flat), lanes=1).has_rom
    assert not DepthOutput(Depth("absolute", 9, curved), lanes=1).has_rom
    for mode in ("absolute", "difference"):
        depth = Depth(mode, 9, curved)
        dut = Displacement(depth, DisplacementQuantiser(depth.width, 0, 8), lanes=1)
        assert dut.has_rom == (mode == "absolute")


def test_words_of_a_table():
    table = np.random.default_rng(3).integers(-8, 8, (5, 5))
    words = raster_beats(table, 2)
    assert words.shape == (15, 2)
    assert RasterRom(words, 4).words == pack(words, 4)


def test_refusals():
    depth = Depth("absolute", 10, np.ones((8, 8), dtype=int))
    quantiser = DisplacementQuantiser(depth.width, 2, 8)
    with pytest.raises(ValueError, match="lanes 3: expected one of"):
        Displacement(depth, quantiser, lanes=3)
    with pytest.raises(ValueError, match=r"quantiser.input_width 9: expected 11"):
        Displacement(depth, DisplacementQuantiser(9, 2, 8), lanes=1)
    with pytest.raises(ValueError, match=r"rest \(8, 9\): expected square"):
        DepthOutput(Depth("absolute", 10, np.ones((8, 9), dtype=int)), lanes=1)
