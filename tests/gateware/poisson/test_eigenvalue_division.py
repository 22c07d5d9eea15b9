# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from rounding import at_the_edges

from fastac.gateware.poisson.eigenvalue_division import EigenvalueDivider
from fastac.models.integer.dst2d import EigenvalueDivision
from fastac.models.integer.words import half_unit, signed_width
from fastac.sim.check_stream import check, pack


def eigenvalue_division(size: int, *, input_width: int, rounding: str = "nearest") -> EigenvalueDivision:
    cosine = 2 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1))
    reciprocal = 1 / (4 - (cosine[:, None] + cosine))
    shift = 16 - np.floor(np.log2(reciprocal)).astype(np.int64)
    mantissa = np.minimum(np.round(reciprocal * 2.0**shift), (1 << 17) - 1).astype(np.int64)
    bound = int(((mantissa << (input_width - 1)) >> shift).max()) + 1
    return EigenvalueDivision(mantissa, shift, input_width, signed_width(bound), rounding)


def at_the_edges_of(division: EigenvalueDivision, frames: int) -> np.ndarray:
    """Coefficients (frames, N, N) whose quotients one unit more, or less, would round to another value."""
    size, width = division.size, division.input_width
    limit = 1 << (width - 1)
    x = np.arange(-limit, limit) if width <= 18 else np.random.default_rng(3).integers(-limit, limit, 1 << 18)
    found = np.empty((frames, size, size), np.int64)
    for place in np.ndindex(size, size):
        mantissa, shift = int(division.mantissa[place]), int(division.shift[place])
        half = int(half_unit(shift, division.rounding))
        found[:, *place] = at_the_edges(x, -mantissa, shift, half, frames)
    return found


def by_beats(rows, lanes: int, void: int) -> np.ndarray:
    """Rows (rows, N) to beats (beats, lanes); `void` fills the unused lanes of each row's last beat."""
    short = -rows.shape[1] % lanes
    return np.hstack([rows, np.full((len(rows), short), void)]).reshape(-1, lanes)


def compare(folder, division, lanes: int, fold: int = 1):
    size, width = len(division.mantissa), division.input_width
    dut = EigenvalueDivider(division, lanes=lanes, fold=fold)
    limit = 1 << (width - 1)
    x = np.random.default_rng(1).integers(-limit, limit, (6, size, size))
    x[0], x[1], x[2] = 0, -limit, limit - 1
    # Small values, whose quotients are near the rounding thresholds.
    x[3] = np.random.default_rng(2).integers(-9, 10, (size, size))
    x = np.vstack([x, at_the_edges_of(division, 6)])
    quotients = division(x).reshape(-1, size)
    check(
        dut,
        "eigenvalue_division",
        folder,
        room=dut.latency + 1,
        inputs=pack(by_beats(x.reshape(-1, size), lanes, -1), width),
        expected=pack(by_beats(quotients, lanes, 0), division.output_width),
        mask=pack(by_beats(np.full_like(quotients, -1), lanes, 0), division.output_width),
        latencies=[(k, k, dut.latency) for k in range(0, quotients.size // lanes, 7)],
    )


@pytest.mark.parametrize(
    ("size", "lanes", "fold", "input_width", "rounding"),
    [
        (14, 1, 1, 27, "nearest"),
        (15, 2, 1, 18, "nearest"),
        (15, 2, 1, 18, "floor"),
        (7, 1, 2, 18, "nearest"),  # a triangle of a table
    ],
)
@pytest.mark.quick("15-2-1-18-floor", mutate=["7-1-2-18-nearest"])
def test_bit_exact_to_golden_model(tmp_path, size, lanes, fold, input_width, rounding):
    division = eigenvalue_division(size, input_width=input_width, rounding=rounding)
    assert division.shift.min() < division.shift.max()
    compare(tmp_path, division, lanes, fold)


def test_single_shift_needs_no_barrel_shifter(tmp_path):
    division = EigenvalueDivision(np.full((6, 6), (1 << 16) + 1), np.full((6, 6), 1), 8, 24)
    assert EigenvalueDivider(division, lanes=4).latency == 5
    compare(tmp_path, division, 4)


def test_invalid_arguments():
    with pytest.raises(ValueError, match="lanes 8: expected 1, 2 or 4"):
        EigenvalueDivider(eigenvalue_division(5, input_width=9), lanes=8)
