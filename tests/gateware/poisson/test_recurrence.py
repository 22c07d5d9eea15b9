# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from rounding import to_the_edge

from fastac.gateware.poisson.frame_reversal import FrameReversal
from fastac.gateware.poisson.recurrence import RowRecurrence
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.tridiagonal import Elimination, Substitution, thomas_coefficients
from fastac.sim.check_stream import check, pack

FRAMES = 4


def by_beats(frames, lanes: int, void: int) -> np.ndarray:
    """Frames (..., N, N) to beats (beats, lanes); `void` fills the unused lanes of each row's last beat."""
    rows = frames.reshape(-1, frames.shape[-1])
    short = -rows.shape[1] % lanes
    return np.hstack([rows, np.full((len(rows), short), void)]).reshape(-1, lanes)


def table(size: int) -> np.ndarray:
    """Coefficients (rows, modes) that all differ, except that each mode is constant from some row on."""
    rng = np.random.default_rng(size)
    c = thomas_coefficients(size, 17) - rng.integers(0, 20000, (size, size))
    last = rng.permutation(size)
    return np.take_along_axis(c, np.minimum(np.arange(size)[:, None], last), axis=0)


def at_the_edges(recurrence, frames: int) -> np.ndarray:
    """Frames (frames, N, N) with whose rows a product one unit more, or less, would round to another value.

    An input is chosen for the product that it is in: an elimination's own row's; a substitution's next row's,
    and, by its lowest bits, its own. A product that is 0 is passed over: no bit of it can carry.
    """
    c, shift, half = recurrence.coefficient, recurrence.shift, recurrence.half_unit
    size, downwards = len(c), isinstance(recurrence, Elimination)
    rng, x, never = np.random.default_rng(2), np.arange(-(2**13), 2**13)[:, None], 1 << shift
    found = np.empty((frames, size, size), np.int64)
    for frame in found:
        past = np.zeros(size, np.int64)
        for row in range(size) if downwards else range(size - 1, -1, -1):
            if downwards:
                totals = (past - x) * c[row] + half
                distance = to_the_edge(totals, shift) + never * (x == past)
            else:
                totals = past * c[row] + (x << (shift - recurrence.drop)) + half
                results = totals >> shift
                distance = to_the_edge(totals, shift) + to_the_edge(results * c[row - 1] + half, shift)
                distance += never * (results == 0)
            nearest = np.argpartition(distance, frames, axis=0)[:frames]
            chosen = np.take_along_axis(nearest, rng.integers(0, frames, (1, size)), axis=0)
            frame[row] = x[chosen[0], 0]
            past = np.take_along_axis(totals, chosen, axis=0)[0] >> shift
    return found


@pytest.mark.parametrize(
    ("kind", "size", "lanes", "rounding"),
    [
        ("elimination", 5, 1, "nearest"),
        ("elimination", 18, 4, "nearest"),
        ("substitution", 14, 2, "nearest"),
        ("substitution", 18, 4, "nearest"),
        ("elimination", 11, 2, "floor"),
        ("substitution", 14, 2, "floor"),
    ],
)
@pytest.mark.quick("elimination-5-1-nearest", "substitution-14-2-floor", mutate=["elimination-18-4-nearest"])
def test_recurrence_bit_exact_to_golden_model(tmp_path, kind, size, lanes, rounding):
    inputs = np.random.default_rng(1).integers(-(2**13), 2**13, (FRAMES, size, size))
    inputs[0], inputs[1] = -(2**13), 2**13 - 1
    if kind == "elimination":
        recurrence = Elimination(table(size), 17, 14, 20, rounding=rounding)
    else:
        recurrence = Substitution(table(size), 17, 14, 20, drop=size % 4, rounding=rounding)
    inputs = np.vstack([inputs, at_the_edges(recurrence, FRAMES)])
    expected = recurrence(inputs)
    step = 1 if kind == "elimination" else -1
    fed, expected = inputs[:, ::step], expected[:, ::step]
    dut = RowRecurrence(recurrence, lanes=lanes)
    beats = len(inputs) * size * dut.beats
    check(
        dut,
        "recurrence",
        tmp_path,
        elastic=True,
        inputs=pack(by_beats(fed, lanes, 0x155), 14),
        expected=pack(by_beats(expected, lanes, 0), 20),
        mask=pack(by_beats(np.full_like(expected, -1), lanes, 0), 20),
        latencies=[(k, k, dut.latency) for k in range(beats)],
    )


@pytest.mark.parametrize("kind", ["elimination", "substitution"])
def test_tables_store_converged_coefficients_once(kind):
    c = thomas_coefficients(126, 17)
    recurrence = Elimination(c, 17, 26, 26) if kind == "elimination" else Substitution(c, 17, 26, 26, 5)
    places, words = RowRecurrence(recurrence, lanes=4).tables()
    assert sum(map(len, words)) < 126 * 126 / 12
    for mode in range(126):
        place = places[mode % 4][mode // 4]
        found = [words[mode % 4][place["start"] + min(row, place["last"])] for row in range(126)]
        np.testing.assert_array_equal(found, c[:, mode])


@pytest.mark.parametrize(("size", "lanes"), [(5, 1), (14, 4), (7, 2)])
@pytest.mark.quick("7-2")
def test_reversal(tmp_path, size, lanes):
    frames = 12  # as many that the writer is seen to wait for the page
    values = np.random.default_rng(1).integers(-(2**10), 2**10, (frames, size, size))
    dut = FrameReversal(size, 11, lanes=lanes)
    row, frame = dut.beats, size * dut.beats
    check(
        dut,
        "reversal",
        tmp_path,
        inputs=pack(by_beats(values, lanes, 0x155), 11),
        expected=pack(by_beats(values[:, ::-1], lanes, 0), 11),
        mask=pack(by_beats(np.full_like(values, -1), lanes, 0), 11),
        # A writer at full rate never waits for the page.
        latencies=[(f * frame + frame - row, f * frame, dut.latency) for f in range(frames)]
        + [(0, frames * frame - 1, (frames + 1) * frame - row - 1 + dut.latency)],
    )


def test_invalid_arguments():
    c = thomas_coefficients(8, 17)
    with pytest.raises(ValueError, match="lanes 3: expected 1, 2 or 4"):
        RowRecurrence(Elimination(c, 17, 10, 10), lanes=3)
    with pytest.raises(ValueError, match="rows of 8 values, 4 beats: expected at least 5 beats"):
        RowRecurrence(Elimination(c, 17, 10, 10), lanes=2)
    with pytest.raises(ValueError, match="recurrence SineTransform: expected Elimination or Substitution"):
        RowRecurrence(SineTransform(np.eye(8, dtype=int), 1, 10, 10), lanes=1)
    with pytest.raises(ValueError, match="lanes 8: expected 1, 2 or 4"):
        FrameReversal(14, 10, lanes=8)
    with pytest.raises(ValueError, match="size 4: expected more than lanes = 4"):
        FrameReversal(4, 10, lanes=4)
