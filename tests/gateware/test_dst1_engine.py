# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.dst1_engine import Dst1Engine
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.words import signed_width
from fastac.sim.check_stream import check, pack


def sine_transform(
    size: int, *, input_width: int, fraction: int = 16, shift: int = 15, rounding: str = "nearest"
) -> SineTransform:
    k = np.arange(1, size + 1)
    sine = np.sin(np.pi / (size + 1) * (np.outer(k, k) % (2 * size + 2)))
    matrix = np.round(2.0**fraction * np.sqrt(2 / (size + 1)) * sine).astype(np.int64)
    bound = int(np.abs(matrix).sum(axis=1).max()) << (input_width - 1)
    # The largest output: rounded to nearest, or for a floor the negated sum, which is farther from 0.
    top = bound + (1 << shift >> 1) >> shift if rounding == "nearest" else -(-bound >> shift)
    return SineTransform(matrix, shift, input_width, signed_width(top), rounding)


def rows_at_the_rounding_edges(transform: SineTransform, rng, count: int) -> np.ndarray:
    """`count` random rows, each with a sum that one unit more, or less, would round to another output.

    Every output in turn, on either side of an edge, so that the edges of every adder's outputs are met.
    """
    limit = 1 << (transform.input_width - 1)
    rows = rng.integers(-limit, limit, (1_000_000 // transform.size, transform.size))
    below = (rows @ transform.matrix + transform.half_unit) % (1 << transform.shift)
    distance = np.hstack([below, (1 << transform.shift) - 1 - below])
    turns = rng.permutation(distance.shape[1])
    nearest = np.argsort(distance[:, turns], axis=0, kind="stable")
    return rows[nearest.ravel()[:count]]


def by_beats(rows, lanes: int, void) -> np.ndarray:
    """Rows (rows, N) to beats (beats, lanes); `void` fills the unused lanes of each row's last beat."""
    short = -rows.shape[1] % lanes
    return np.hstack([rows, np.full((len(rows), short), void)]).reshape(-1, lanes)


@pytest.mark.parametrize(
    ("size", "lanes", "input_width", "rounding"),
    [
        (14, 1, 20, "nearest"),
        (15, 1, 26, "nearest"),
        (14, 2, 3, "nearest"),
        (17, 4, 20, "nearest"),
        (14, 4, 20, "nearest"),
        (15, 1, 20, "floor"),
        (254, 1, 26, "nearest"),
    ],
)
@pytest.mark.quick("14-4-20-nearest", mutate=["15-1-20-floor"])
def test_bit_exact_to_golden_model(tmp_path, size, lanes, input_width, rounding):
    transform = sine_transform(size, input_width=input_width, rounding=rounding)
    dut = Dst1Engine(transform, lanes=lanes)
    limit = 1 << (input_width - 1)
    # Extremes first: zeros, both limits, and the signs that reach the bound of each accumulator.
    extremes = [np.zeros(size), np.full(size, limit - 1), np.full(size, -limit)]
    for row in transform.matrix[:: size // 14]:
        extremes += [np.where(row > 0, -limit, limit - 1), np.where(row < 0, -limit, limit - 1)]
    rng = np.random.default_rng(1)
    edges = rows_at_the_rounding_edges(transform, rng, max(40, 1680 // size))
    rows = np.vstack([extremes, edges, rng.integers(-limit, limit, (840 // size, size))]).astype(np.int64)
    transformed = transform(rows)
    assert signed_width(int(np.abs(transformed).max())) == transform.output_width

    beats = dut.interval
    check(
        dut,
        "dst1_engine",
        tmp_path,
        inputs=pack(by_beats(rows, lanes, limit - 1), input_width),
        expected=pack(by_beats(transformed, lanes, 0), transform.output_width),
        mask=pack(by_beats(np.full_like(rows, -1), lanes, 0), transform.output_width),
        latencies=[
            *((r * beats + beats - 1, r * beats, dut.latency) for r in range(len(rows))),
            # A row every `interval` clocks, from the first value in to the last one out.
            (0, len(rows) * beats - 1, (len(rows) + 1) * beats - 2 + dut.latency),
        ],
        # Long pauses are for the small ones: here they would take longer than all the rest.
        stalls=(0, 0.3, 0.9) if size < 200 else (0, 0.3),
    )


@pytest.mark.parametrize("rounding", ["nearest", "floor"])
@pytest.mark.parametrize(
    ("lanes", "interval", "latency", "multipliers"), [(1, 126, 11, 63), (2, 63, 11, 126), (4, 32, 11, 252)]
)
@pytest.mark.quick("1-126-11-63-nearest", "4-32-11-252-floor")
def test_cost_of_the_paper_s_rows(lanes, interval, latency, multipliers, rounding):
    dut = Dst1Engine(sine_transform(126, input_width=20, rounding=rounding), lanes=lanes)
    assert (dut.interval, dut.latency, dut.multipliers) == (interval, latency, multipliers)


def test_invalid_arguments():
    transform = sine_transform(14, input_width=20)
    with pytest.raises(ValueError, match="lanes 3: expected 1, 2 or 4"):
        Dst1Engine(transform, lanes=3)
    with pytest.raises(ValueError, match="size 4: expected more than lanes = 4"):
        Dst1Engine(sine_transform(4, input_width=20), lanes=4)
    matrix = transform.matrix.copy()
    matrix[0, 0] += 1
    with pytest.raises(ValueError, match="matrix: expected rows even and odd"):
        Dst1Engine(SineTransform(matrix, 15, 20, 24), lanes=1)
