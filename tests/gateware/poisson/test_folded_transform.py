# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.poisson.folded_transform import FoldedDst1
from fastac.models.integer.bounds import coefficients
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.words import signed_width
from fastac.sim.check_stream import check, pack


def sine_transform(size: int, *, input_width: int, shift: int = 15, rounding: str = "nearest"):
    """A transform whose output word holds its largest output."""
    matrix = coefficients(size, 16)
    bound = int(np.abs(matrix).sum(axis=1).max()) << (input_width - 1)
    top = bound + (1 << shift >> 1) >> shift if rounding == "nearest" else -(-bound >> shift)
    return SineTransform(matrix, shift, input_width, signed_width(top), rounding)


def rows_of(transform: SineTransform) -> np.ndarray:
    """Zeros, both limits, the signs that reach the bounds of accumulators, and noise."""
    size, limit = transform.size, 1 << (transform.input_width - 1)
    extremes = [np.zeros(size), np.full(size, limit - 1), np.full(size, -limit)]
    for row in transform.matrix[:: max(size // 6, 1)]:
        extremes += [np.where(row > 0, -limit, limit - 1), np.where(row < 0, -limit, limit - 1)]
    noise = np.random.default_rng(1).integers(-limit, limit, (6, size))
    return np.vstack([*extremes, noise]).astype(np.int64)


@pytest.mark.parametrize(
    ("size", "fold", "input_width", "rounding"),
    [
        (14, 2, 20, "nearest"),  # 4 products
        (13, 4, 3, "floor"),  # a middle value; the second product has 3 pairs of 4
        (2, 8, 20, "nearest"),
        (40, 8, 26, "nearest"),  # 3 products, not a power of two
        (19, 16, 26, "floor"),
        pytest.param(126, 16, 26, "nearest", marks=pytest.mark.full),
    ],
)
@pytest.mark.quick("13-4-3-floor")
def test_bit_exact_to_golden_model(tmp_path, size, fold, input_width, rounding):
    transform = sine_transform(size, input_width=input_width, rounding=rounding)
    dut, rows = FoldedDst1(transform, fold=fold), rows_of(transform)
    latencies = [
        # From row to row there is no pause, however early the next row comes.
        *((size - 1, n, dut.latency + n * fold) for n in range(len(rows) * size)),
    ]
    check(
        dut,
        "folded_dst1",
        tmp_path,
        inputs=pack(rows.reshape(-1, 1), input_width),
        expected=pack(transform(rows).reshape(-1, 1), transform.output_width),
        latencies=latencies,
    )


@pytest.mark.parametrize(
    ("fold", "interval", "latency", "multipliers"), [(2, 252, 40, 32), (16, 2016, 26, 4)]
)
def test_cost_of_the_paper_s_rows(fold, interval, latency, multipliers):
    dut = FoldedDst1(sine_transform(126, input_width=26), fold=fold)
    assert (dut.interval, dut.latency, dut.multipliers) == (interval, latency, multipliers)


def test_invalid_arguments():
    transform = sine_transform(14, input_width=20)
    with pytest.raises(ValueError, match=r"fold 3: expected one of \(2, 4, 8, 16\)"):
        FoldedDst1(transform, fold=3)
    with pytest.raises(ValueError, match="matrix of size 1: expected at least 2"):
        FoldedDst1(sine_transform(1, input_width=20), fold=2)
    matrix = transform.matrix.copy()
    matrix[3, 3] += 1
    with pytest.raises(ValueError, match="matrix: expected multiples of the sine at k"):
        FoldedDst1(SineTransform(matrix, 15, 20, 24), fold=2)
