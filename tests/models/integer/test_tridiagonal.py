"""The tridiagonal solver: against dense solves, the float solver, and its own worst cases."""

from functools import partial

import numpy as np
import pytest
from scipy.linalg import lu

from fastac.models.integer.laplacian import sine_matrix
from fastac.models.integer.tridiagonal import (
    Elimination,
    Substitution,
    TridiagonalSolver,
    row_operators,
    thomas_coefficients,
)
from tests.shared import solver_cases
from tests.shared.solver_cases import (
    DIVERGENCES,
    MODES,
    Case,
    check_random_slopes,
    check_worst_slopes,
    smooth_surface_error,
)

STAGES = ("row_forward", "elimination", "back_substitution", "row_inverse")
HALVES = {"nearest": 0.5, "floor": 0.0}
"""By rounding: what is added before the fraction is dropped."""
make = partial(solver_cases.make, TridiagonalSolver)


def trace(case: Case, slopes: np.ndarray) -> dict[str, np.ndarray]:
    """Every word of the integer solver, (frames, N, N)."""
    source, s = case.source(slopes), case.solver
    r = s.row_forward(source)
    y = s.elimination(r)
    z = s.substitution(y)
    words = {"source": source} | dict(zip(STAGES, (r, y, z, s.row_inverse(z)), strict=True))
    np.testing.assert_array_equal(words["row_inverse"], s(source))
    return words


def systems(n: int) -> np.ndarray:
    """Each mode's matrix, (mode, i, k): d on the diagonal, −1 beside it; times z it is −r."""
    d = 2 + 4 * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1))) ** 2
    return d[:, None, None] * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)


def ideal_operators(n: int) -> dict[str, np.ndarray]:
    """The exact linear maps from the source to each stage, as dense matrices."""
    s = sine_matrix(n)
    down, up = np.zeros((n, n, n, n)), np.zeros((n, n, n, n))  # (i, mode, k, mode)
    for mode, system in enumerate(systems(n)):
        lower, upper = lu(system, permute_l=True)
        pivots = np.diag(upper)[:, None]
        down[:, mode, :, mode] = -np.linalg.inv(lower) / pivots
        up[:, mode, :, mode] = np.linalg.inv(upper / pivots)
    rows = np.kron(np.eye(n), s)
    y = down.reshape(n * n, n * n) @ rows
    z = up.reshape(n * n, n * n) @ y
    return dict(zip(STAGES, (rows, y, z, rows @ z), strict=True))


@pytest.mark.parametrize("size", [14, 126])
def test_coefficients_are_exact_until_they_are_within_half_a_unit_of_their_limit(size):
    found = thomas_coefficients(size, 17) * 2.0**-17
    d = systems(size)[:, 0, 0]
    limit = (d - np.sqrt(d**2 - 4)) / 2
    exact = 1 / d
    for row in found:
        close = np.abs(exact - limit) <= 2.0**-18
        np.testing.assert_array_equal(row[close], np.rint(limit[close] * 2**17) / 2**17)
        assert np.abs(row - exact)[~close].max(initial=0) <= 2.0**-18
        exact = 1 / (d - exact)
    last = Elimination(thomas_coefficients(size, 17), 17, 20, 20).varying
    for mode, row in enumerate(last):
        assert (found[row:, mode] == found[row, mode]).all()
        assert row == 0 or found[row - 1, mode] != found[row, mode]


@pytest.mark.parametrize(("rounding", "half"), HALVES.items())
def test_recurrences_round_each_step(rounding, half):
    n, rng = 5, np.random.default_rng(1)
    c = thomas_coefficients(n, 9)
    eliminate = Elimination(c, 9, 20, 20, rounding=rounding)
    substitute = Substitution(c, 9, 20, 20, drop=4, rounding=rounding)
    r = rng.integers(-1000, 1000, (3, n, n))
    y, z = eliminate(r), substitute(r)
    for frame in range(3):
        for mode in range(n):
            above = below = 0
            for i in range(n):
                above = int(np.floor(c[i, mode] * (above - r[frame, i, mode]) / 512 + half))
                assert y[frame, i, mode] == above
                k = n - 1 - i
                below = int(np.floor(c[k, mode] * below / 512 + r[frame, k, mode] / 16 + half))
                assert z[frame, k, mode] == below


def test_recurrences_solve_each_mode_s_system():
    n, rng = 20, np.random.default_rng(2)
    c = thomas_coefficients(n, 17)
    r = rng.integers(-(2**18), 2**18, (n, n))
    z = Substitution(c, 17, 26, 26, drop=2)(Elimination(c, 17, 26, 26)(r))
    for mode, system in enumerate(systems(n)):
        dense = np.linalg.solve(system, -r[:, mode] * 0.25)
        assert np.abs(z[:, mode] - dense).max() < 1e-4 * np.abs(dense).max() + 5


@pytest.mark.parametrize(("rounding", "half"), HALVES.items())
@pytest.mark.parametrize("kind", [Elimination, Substitution])
def test_roundings_add_up_to_what_the_bound_allows_them(kind, rounding, half):
    """The lowest mode, driven by inputs that make every rounding as large as it can be: upwards to the
    nearest, downwards with a floor, which has no other way."""
    n = 60
    table = thomas_coefficients(n, 17)
    c = table[:, 0] * 2.0**-17
    down = kind is Elimination
    recurrence = kind(table, 17, 26, 26, **({} if down else {"drop": 9}), rounding=rounding)
    sign, largest = (1, 0.5) if rounding == "nearest" else (-1, 1.0)
    inputs, candidates = np.zeros((n, n), int), np.arange(-300, 301)
    rounded, exact, words = 0, 0.0, np.zeros(n, int)
    errors, allowed, before = np.zeros(n), np.zeros(n), 0.0
    for i in range(n) if down else reversed(range(n)):
        steps = c[i] * (rounded - candidates) if down else c[i] * rounded + candidates / 512
        k = (sign * (np.floor(steps + half) - steps)).argmax()
        inputs[i, 0] = candidates[k]
        rounded = int(np.floor(steps[k] + half))
        exact = c[i] * (exact - candidates[k]) if down else c[i] * exact + candidates[k] / 512
        words[i], errors[i], allowed[i] = rounded, sign * (rounded - exact), largest + c[i] * before
        before = allowed[i]
    np.testing.assert_array_equal(recurrence(inputs)[:, 0], words)
    ways = row_operators(table * 2.0**-17)[0 if down else 1][0].sum(axis=1) * largest
    np.testing.assert_allclose(allowed, ways)
    assert (errors <= allowed + 1e-9).all()
    assert errors.max() > 0.95 * allowed.max() > 4


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("divergence", DIVERGENCES)
@pytest.mark.parametrize(
    ("n", "data_bits", "rounding"),
    [(7, 26, "nearest"), (8, 26, "nearest"), (8, 14, "nearest"), (8, 26, "floor"), (8, 14, "floor")],
)
def test_worst_slopes_come_close_to_every_bound_and_never_beyond(n, data_bits, rounding, divergence, mode):
    case = make(n, divergence, mode, data_bits=data_bits, rounding=rounding)
    check_worst_slopes(case, ideal_operators(n), trace, exact=data_bits == 26, last_share=0.95)


@pytest.mark.parametrize("rounding", HALVES)
@pytest.mark.parametrize("coefficient_fraction", [8, 17])
@pytest.mark.parametrize("divergence", DIVERGENCES)
def test_saturated_random_slopes_stay_inside(divergence, coefficient_fraction, rounding):
    case = make(
        14,
        divergence,
        "absolute",
        data_bits=20,
        coefficient_fraction=coefficient_fraction,
        rounding=rounding,
    )
    check_random_slopes(case, trace)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("data_bits", [12, 18, 26])
def test_widths_follow_the_words_and_fit_the_multiplier(mode, data_bits):
    case = make(9, "central", mode, data_bits=data_bits)
    chosen, words = case.solver, [stage.format for stage in case.solver.stages]
    widths = [case.source.width, *(word.width for word in words)]
    parts = (chosen.row_forward, chosen.elimination, chosen.substitution, chosen.row_inverse)
    for part, into, out in zip(parts, widths[:-1], widths[1:], strict=True):
        assert (part.input_width, part.output_width) == (into, out)
    assert max(widths[1:]) <= data_bits
    r, y, z, _ = words
    assert r.fraction == y.fraction == z.fraction + chosen.substitution.drop
    assert chosen.depth_format is words[-1]
    for stage in chosen.stages:
        assert stage.format.limit * 2.0**-stage.format.fraction >= stage.bound_px


@pytest.mark.parametrize("data_bits", [14, 26])
def test_a_floor_s_words_hold_whole_units_of_error(data_bits):
    nearest, floor = (
        make(14, "central", "absolute", data_bits=data_bits, rounding=rounding).solver for rounding in HALVES
    )
    assert nearest.stages[0] == floor.stages[0]  # no rounding comes before it
    for a, b in zip(nearest.stages[1:], floor.stages[1:], strict=True):
        assert a.bound_px < b.bound_px < a.bound_px + 200 * 2.0**-a.format.fraction
        assert b.format.limit * 2.0**-b.format.fraction >= b.bound_px
    parts = (floor.row_forward, floor.elimination, floor.substitution, floor.row_inverse)
    assert {part.rounding for part in parts} == {"floor"}


@pytest.mark.parametrize(
    ("coefficient_fraction", "data_bits", "tolerance"), [(17, 26, 1e-4), (12, 26, 5e-3), (17, 18, 5e-3)]
)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("divergence", DIVERGENCES)
def test_integer_solver_approximates_the_float_one(
    divergence, mode, coefficient_fraction, data_bits, tolerance
):
    """`tolerance`, a share of the depth, is what few bits cost."""
    case = make(30, divergence, mode, data_bits=data_bits, coefficient_fraction=coefficient_fraction)
    error = smooth_surface_error(case)
    assert tolerance / 40 < error < tolerance  # a tolerance that says something


def test_refusals():
    c = thomas_coefficients(6, 10)
    with pytest.raises(ValueError, match=r"coefficient \(5, 6\): expected square"):
        Elimination(c[1:], 10, 12, 12)
    with pytest.raises(ValueError, match="shift 18: expected 1 to 17"):
        Elimination(c, 18, 12, 12)
    with pytest.raises(ValueError, match=r"coefficient [0-9]+ to [0-9]+: expected 0 to 511"):
        Elimination(c, 9, 12, 12)
    with pytest.raises(ValueError, match="drop 11: expected 0 to shift = 10"):
        Substitution(c, 10, 12, 12, drop=11)
    with pytest.raises(ValueError, match="rounding 'up': expected nearest or floor"):
        Elimination(c, 10, 12, 12, rounding="up")
    with pytest.raises(ValueError, match="rounding 'up': expected nearest or floor"):
        make(14, "central", "absolute", rounding="up")
    with pytest.raises(ValueError, match="5 data bits cannot hold the bound"):
        make(14, "central", "absolute", data_bits=5)
