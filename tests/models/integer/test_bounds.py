"""The solver's worst cases: reached by the slopes that an independent linear model says are the worst."""

from dataclasses import dataclass

import numpy as np
import pytest

from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer.bounds import coefficients
from fastac.models.integer.dst2d import Solver, reciprocals
from fastac.models.integer.laplacian import boundary_term, sine_matrix
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import Fixed, to_words

STAGES = ("row_forward", "column_forward", "division", "column_inverse", "row_inverse")
SLOPE_FRACTION = 10
LIMIT = 4 * 2**SLOPE_FRACTION - 1
"""The largest word of a slope: 4 px per px."""
DIVERGENCES = ("central", "backward")
MODES = ("absolute", "difference")


@dataclass
class Case:
    divergence: str
    source: PoissonSource
    fraction: int  # of the source
    solver: Solver


ROUNDINGS = ("nearest", "floor")


def make(
    n: int,
    divergence: str,
    mode: str,
    *,
    data_bits: int = 26,
    coefficient_fraction: int = 17,
    rounding: str = "nearest",
) -> Case:
    rng = np.random.default_rng(n)
    fraction = SLOPE_FRACTION + (divergence == "central")
    v, u = np.indices((n + 2, n + 2)) / (n + 1) - 0.5
    if mode == "absolute":
        offset = to_words(boundary_term(n * (1 - u**2 - 2 * v**2)), Fixed(40, fraction))
    else:
        rest = rng.integers(-LIMIT // 8, LIMIT // 8, (n + 2, n + 2, 2))
        offset = PoissonSource(divergence, 13, np.zeros((n, n), int))(rest)
    source = PoissonSource(divergence, 13, offset)
    chosen = Solver.fitted(
        offset=offset,
        source=Fixed(source.width, fraction),
        slope_limit=LIMIT / 2**SLOPE_FRACTION,
        divergence=divergence,
        coefficient_fraction=coefficient_fraction,
        data_bits=data_bits,
        rounding=rounding,
    )
    return Case(divergence, source, fraction, chosen)


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


def ideal_operators(n: int, divergence: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The exact linear maps, as dense matrices: slopes to source in px, and source to each stage."""
    h = n + 2
    step = 1 if divergence == "central" else 0
    weight = 0.5 if divergence == "central" else 1.0
    d = np.zeros((n * n, h, h, 2))
    for i in range(n):
        for j in range(n):
            row = d[i * n + j]
            row[i + 1, j + 1 + step, 0] += weight
            row[i + 1, j, 0] -= weight
            row[i + 1 + step, j + 1, 1] += weight
            row[i, j + 1, 1] -= weight
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
    return d.reshape(n * n, -1), found


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("divergence", DIVERGENCES)
@pytest.mark.parametrize(
    ("n", "data_bits", "rounding"),
    [(7, 26, "nearest"), (8, 26, "nearest"), (8, 14, "nearest"), (8, 26, "floor"), (8, 14, "floor")],
)
def test_worst_slopes_come_close_to_every_bound_and_never_beyond(n, data_bits, rounding, divergence, mode):
    case = make(n, divergence, mode, data_bits=data_bits, rounding=rounding)
    d, operators = ideal_operators(n, divergence)
    constant = case.source.offset.ravel() * 2.0**-case.fraction
    formats = {stage.name: stage for stage in case.solver.stages}
    assert tuple(formats) == STAGES
    for name in STAGES:
        rows = operators[name] @ d
        away = -(operators[name] @ constant)
        worst = np.abs(rows).sum(axis=1) * LIMIT * 2.0**-SLOPE_FRACTION + np.abs(away)
        # One frame for each word of the stage: the slopes that drive it furthest.
        slopes = LIMIT * np.sign(rows) * np.where(away < 0, -1, 1)[:, None]
        words = trace(case, np.rint(slopes).astype(np.int64).reshape(n * n, n + 2, n + 2, 2))
        for stage, word in formats.items():
            assert np.abs(words[stage]).max() <= word.format.limit, stage
            assert np.abs(words[stage]).max() * 2.0**-word.format.fraction <= word.bound_px + (
                2.0**-word.format.fraction
            ), stage
        assert np.abs(words["source"]).max() <= case.source.bound
        k = worst.argmax()
        reached = abs(words[name].reshape(n * n, -1)[k, k]) * 2.0 ** -formats[name].format.fraction
        assert reached == pytest.approx(worst[k], rel=0.02), name
        if data_bits == 26:  # with coarse words, the bound allows for larger roundings
            # Exact but for row_inverse: there the worst slopes' pixel need not be the worst constant's.
            tightness = 0.96 if name == "row_inverse" else 0.999
            assert reached >= tightness * formats[name].bound_px, name
        assert formats[name].bound_px >= worst[k] * (1 - 1e-4), name


@pytest.mark.parametrize("rounding", ROUNDINGS)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("divergence", DIVERGENCES)
def test_saturated_random_slopes_stay_inside(divergence, mode, rounding):
    case = make(14, divergence, mode, data_bits=20, rounding=rounding)
    rng = np.random.default_rng(3)
    signs = rng.choice([-LIMIT, LIMIT], (200, 16, 16, 2))
    blocks = rng.choice([-LIMIT, LIMIT], (200, 4, 4, 2)).repeat(4, axis=1).repeat(4, axis=2)
    words = trace(case, np.concatenate([signs, blocks]))
    for stage in case.solver.stages:
        assert np.abs(words[stage.name]).max() <= stage.format.limit


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
    """On a smooth surface some 10 px high; `tolerance`, a share of that, is what few bits cost."""
    n = 30
    case = make(n, divergence, mode, data_bits=data_bits, coefficient_fraction=coefficient_fraction)
    v, u = np.indices((n + 2, n + 2))
    slopes = np.stack([1.2 * np.cos(u / 6) + 0.3 * np.sin(v / 3), -0.9 * np.sin(v / 7)], axis=-1)
    words = np.rint(slopes * 2**SLOPE_FRACTION).astype(np.int64)
    offset = case.source.offset * 2.0**-case.fraction
    expected = solve(source_of(words * 2.0**-SLOPE_FRACTION, divergence) - offset)
    found = case.solver.depth_format.to_float(case.solver(case.source(words[None]))[0])
    assert np.abs(expected).max() > 5
    error = np.abs(found - expected).max() / np.abs(expected).max()
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
