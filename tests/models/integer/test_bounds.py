"""The solver's worst cases: reached by the slopes that an independent linear model says are the worst."""

from functools import partial

import numpy as np
import pytest

from fastac.models.integer.bounds import coefficients
from fastac.models.integer.dst2d import Solver, reciprocals
from fastac.models.integer.laplacian import sine_matrix
from tests.shared import solver_cases
from tests.shared.solver_cases import (
    DIVERGENCES,
    MODES,
    Case,
    check_random_slopes,
    check_worst_slopes,
    smooth_surface_error,
)

ROUNDINGS = ("nearest", "floor")
make = partial(solver_cases.make, Solver)


def trace(case: Case, slopes: np.ndarray) -> dict[str, np.ndarray]:
    """Every word of the integer solver, (frames, N, N), rows by columns of the image or of their modes."""
    words = {"source": case.source(slopes)}
    s = case.solver
    words["row_forward"] = s.row_forward(words["source"])
    words["column_forward"] = s.column_forward(words["row_forward"].swapaxes(1, 2)).swapaxes(1, 2)
    words["division"] = s.division(words["column_forward"])
    words["column_inverse"] = s.column_inverse(words["division"].swapaxes(1, 2)).swapaxes(1, 2)
    words["row_inverse"] = s.row_inverse(words["column_inverse"])
    np.testing.assert_array_equal(words["row_inverse"], s(words["source"]))
    return words


def ideal_operators(n: int) -> dict[str, np.ndarray]:
    """The exact linear maps from the source to each stage, as dense matrices."""
    k = np.arange(1, n + 1)
    s = np.sqrt(2 / (n + 1)) * np.sin(np.pi * np.outer(k, k) / (n + 1))
    one = 4 * np.sin(np.pi * k / (2 * (n + 1))) ** 2
    reciprocal = -1 / (one[:, None] + one).ravel()
    identity = np.eye(n)
    stages, found = np.eye(n * n), {}
    for name, operator in (
        ("row_forward", np.kron(identity, s)),
        ("column_forward", np.kron(s, identity)),
        ("division", np.diag(reciprocal)),
        ("column_inverse", np.kron(s, identity)),
        ("row_inverse", np.kron(identity, s)),
    ):
        stages = operator @ stages
        found[name] = stages
    return found


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("divergence", DIVERGENCES)
@pytest.mark.parametrize(
    ("n", "data_bits", "rounding"),
    [(7, 26, "nearest"), (8, 26, "nearest"), (8, 14, "nearest"), (8, 26, "floor"), (8, 14, "floor")],
)
def test_worst_slopes_come_close_to_every_bound_and_never_beyond(n, data_bits, rounding, divergence, mode):
    case = make(n, divergence, mode, data_bits=data_bits, rounding=rounding)
    check_worst_slopes(case, ideal_operators(n), trace, exact=data_bits == 26, last_share=0.96)


@pytest.mark.parametrize("rounding", ROUNDINGS)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("divergence", DIVERGENCES)
def test_saturated_random_slopes_stay_inside(divergence, mode, rounding):
    check_random_slopes(make(14, divergence, mode, data_bits=20, rounding=rounding), trace)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("divergence", DIVERGENCES)
def test_widths_of_the_transforms_follow_the_words(divergence, mode):
    case = make(9, divergence, mode)
    chosen, words = case.solver, [stage.format for stage in case.solver.stages]
    widths = [case.source.width, *(word.width for word in words)]
    parts = (
        chosen.row_forward,
        chosen.column_forward,
        chosen.division,
        chosen.column_inverse,
        chosen.row_inverse,
    )
    for part, into, out in zip(parts, widths[:-1], widths[1:], strict=True):
        assert (part.input_width, part.output_width) == (into, out)
    assert chosen.depth_format is words[-1]
    assert max(widths) <= 26


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
    assert tolerance / 20 < error < tolerance  # a tolerance that says something


@pytest.mark.parametrize("data_bits", [14, 26])
def test_a_floor_s_words_hold_whole_units_of_error(data_bits):
    """Of the words before it, whose roundings reach it; the first word sees none."""
    chosen = {r: make(14, "central", "absolute", data_bits=data_bits, rounding=r).solver for r in ROUNDINGS}
    first, *others = zip(chosen["nearest"].stages, chosen["floor"].stages, strict=True)
    assert first[0] == first[1]
    for nearest, floor in others:
        unit = 2.0**-nearest.format.fraction
        assert nearest.bound_px < floor.bound_px < nearest.bound_px + 200 * unit
        assert (
            floor.format.limit * 2.0**-floor.format.fraction >= floor.bound_px + 2.0**-floor.format.fraction
        )
    names = ("row_forward", "column_forward", "division", "column_inverse", "row_inverse")
    assert {getattr(chosen["floor"], name).rounding for name in names} == {"floor"}


def test_an_unknown_rounding_is_refused():
    with pytest.raises(ValueError, match="rounding 'up': expected nearest or floor"):
        make(7, "central", "absolute", rounding="up")


def test_too_few_data_bits_are_refused():
    with pytest.raises(ValueError, match="5 data bits cannot hold the bound"):
        make(14, "central", "absolute", data_bits=5)


def test_fewer_data_bits_cost_fraction_not_range():
    wide, narrow = (
        make(14, "central", "absolute").solver,
        make(14, "central", "absolute", data_bits=14).solver,
    )
    for a, b in zip(wide.stages, narrow.stages, strict=True):
        assert b.format.width <= 14
        assert b.format.fraction < a.format.fraction
        assert b.format.limit * 2.0**-b.format.fraction >= b.bound_px >= a.bound_px


@pytest.mark.parametrize("size", [14, 62, 126, 254])
def test_reciprocals_are_accurate_to_half_a_unit_of_17_bits(size):
    mantissa, exponent = reciprocals(size)
    one = 4 * np.sin(np.pi * np.arange(1, size + 1) / (2 * (size + 1))) ** 2
    ratio = mantissa * 2.0**-exponent * (one[:, None] + one)
    assert np.abs(ratio - 1).max() <= 2.0**-17
    assert mantissa.min() >= 1 << 16
    assert mantissa.max() < 1 << 17


@pytest.mark.parametrize("fraction", [8, 17])
def test_coefficients_are_the_rounded_sines(fraction):
    found = coefficients(14, fraction)
    assert np.abs(found * 2.0**-fraction - sine_matrix(14)).max() <= 2.0 ** -(fraction + 1)
    np.testing.assert_array_equal(found, found.T)
    assert found.dtype == np.int64
