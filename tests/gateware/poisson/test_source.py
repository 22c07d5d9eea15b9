# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.poisson.source import PoissonSourceStream
from fastac.models.integer.laplacian import divergence_of
from fastac.models.integer.source import PoissonSource
from fastac.sim.check_stream import check, pack
from fastac.sim.preloaded import PreloadedTable


def by_beats(rows, lanes: int, void: int) -> np.ndarray:
    """Rows (rows, N) to beats (beats, lanes); `void` fills the unused lanes of each row's last beat."""
    short = -rows.shape[1] % lanes
    return np.hstack([rows, np.full((len(rows), short), void)]).reshape(-1, lanes)


@pytest.mark.parametrize(
    ("divergence", "lanes", "height", "width"),
    [
        ("central", 1, 9, 13),
        ("central", 2, 9, 14),
        ("central", 4, 9, 16),
        ("backward", 1, 9, 13),
        ("backward", 4, 5, 8),
    ],
)
@pytest.mark.quick("central-2-9-14", mutate=["backward-4-5-8"])
def test_bit_exact_to_golden_model(tmp_path, divergence, lanes, height, width):
    bits, frames = 10, 6
    rng = np.random.default_rng(1)
    offset = rng.integers(-700, 700, (height - 2, width - 2))
    source = PoissonSource(divergence, bits, offset)
    dut = PoissonSourceStream(source, height=height, width=width, lanes=lanes)
    # Extremes first: zeros, and the signs of p and q that reach the bound of the divergence.
    slopes = rng.integers(-511, 512, (frames, height, width, 2))
    slopes[0] = 0
    period = 2 if source.divergence == "central" else 1
    sign = 1 - 2 * (np.arange(max(height, width)) // period % 2)
    slopes[1, ..., 0], slopes[1, ..., 1] = 511 * sign[:width], 511 * sign[:height, None]
    slopes[2] = -slopes[1]
    assert np.abs(divergence_of(slopes, divergence)).max() == 4 * 511
    sources = source(slopes).reshape(-1, width - 2)

    # An output beat needs the input beat of its rightmost neighbour, or the last one of that row.
    row, beat = np.divmod(np.arange(frames * (height - 2) * dut.beats), dut.beats)
    frame, row = np.divmod(row, height - 2)
    ahead = dut.delay(0, 0) - dut.latency - dut.rows_ahead * (width // lanes)
    needs = (frame * height + row + dut.rows_ahead) * (width // lanes) + beat + ahead
    check(
        dut,
        "poisson_source",
        tmp_path,
        elastic=True,
        inputs=pack(slopes.reshape(-1, lanes * 2), bits),
        expected=pack(by_beats(sources, lanes, 0), source.width),
        mask=pack(by_beats(np.full_like(sources, -1), lanes, 0), source.width),
        latencies=[
            *((n, k, dut.latency) for k, n in enumerate(needs) if beat[k] + ahead < width // lanes),
            *((n - 1, k, dut.latency + 1) for k, n in enumerate(needs) if beat[k] + ahead == width // lanes),
            (0, 0, dut.delay(0, 0)),
            (0, dut.beats * (height - 2) - 1, dut.delay(height - 3, dut.beats - 1)),
        ],
    )


@pytest.mark.parametrize(("divergence", "lanes", "width"), [("central", 1, 9), ("backward", 4, 12)])
@pytest.mark.quick("central-1-9")
def test_loaded_offsets(tmp_path, divergence, lanes, width):
    """Hardware built with small offsets computes with the largest offsets that its format can hold."""
    bits, frames, height = 10, 3, 6
    rng = np.random.default_rng(2)
    start = PoissonSource(divergence, bits, rng.integers(4, 9, (height - 2, width - 2)))
    source = PoissonSource(divergence, bits, rng.integers(-2040, 2041, (height - 2, width - 2)))
    assert source.width == start.width
    dut = PoissonSourceStream(start, height=height, width=width, lanes=lanes, loadable=True)
    loaded = PoissonSourceStream(source, height=height, width=width, lanes=lanes, loadable=True)
    assert dut.table == loaded.table
    slopes = rng.integers(-511, 512, (frames, height, width, 2))
    sources = source(slopes).reshape(-1, width - 2)
    check(
        PreloadedTable(dut, "offset", loaded.table_values, dut.table.bits),
        "poisson_source",
        tmp_path,
        inputs=pack(slopes.reshape(-1, lanes * 2), bits),
        expected=pack(by_beats(sources, lanes, 0), source.width),
        mask=pack(by_beats(np.full_like(sources, -1), lanes, 0), source.width),
        latencies=[(0, 0, dut.delay(0, 0))],
    )


def test_only_loadable_offsets_can_be_written():
    source = PoissonSource("central", 10, np.zeros((7, 12), dtype=int))
    for loadable in (False, True):
        dut = PoissonSourceStream(source, height=9, width=14, lanes=2, loadable=loadable)
        assert ("offset" in dut.signature.members) == loadable
        assert dut.table == (42, 2, source.width if loadable else 1)


def test_invalid_arguments():
    source = PoissonSource("central", 10, np.zeros((7, 12), dtype=int))
    with pytest.raises(ValueError, match="lanes 3: expected 1, 2 or 4"):
        PoissonSourceStream(source, height=9, width=14, lanes=3)
    with pytest.raises(ValueError, match="width 14: expected a multiple of lanes = 4"):
        PoissonSourceStream(source, height=9, width=14, lanes=4)
    with pytest.raises(ValueError, match=r"offset \(7, 12\): expected \(8, 12\)"):
        PoissonSourceStream(source, height=10, width=14, lanes=2)
