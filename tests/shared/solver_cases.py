"""Integer Poisson solvers to be tested, of either kind, and what both have to do."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer.laplacian import boundary_term
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import Fixed, to_words

SLOPE_FRACTION = 10
LIMIT = 4 * 2**SLOPE_FRACTION - 1
"""The largest word of a slope: 4 px per px."""
DIVERGENCES = ("central", "backward")
MODES = ("absolute", "difference")


@dataclass
class Case:
    """A solver and the right-hand side that it is made for; fraction: of the source's words."""

    divergence: str
    source: PoissonSource
    fraction: int
    solver: IntegerSolver


def make(
    kind: type[IntegerSolver],
    n: int,
    divergence: str,
    mode: str,
    *,
    data_bits: int = 26,
    coefficient_fraction: int = 17,
    rounding: str = "nearest",
) -> Case:
    """A solver of n × n pixels, in mode "absolute" of a bowl, in mode "difference" of any slopes at rest."""
    fraction = SLOPE_FRACTION + (divergence == "central")
    v, u = np.indices((n + 2, n + 2)) / (n + 1) - 0.5
    if mode == "absolute":
        offset = to_words(boundary_term(n * (1 - u**2 - 2 * v**2)), Fixed(40, fraction))
    else:
        rest = np.random.default_rng(n).integers(-LIMIT // 8, LIMIT // 8, (n + 2, n + 2, 2))
        offset = PoissonSource(divergence, 13, np.zeros((n, n), int))(rest)
    source = PoissonSource(divergence, 13, offset)
    chosen = kind.fitted(
        offset=offset,
        source=Fixed(source.width, fraction),
        slope_limit=LIMIT / 2**SLOPE_FRACTION,
        divergence=divergence,
        coefficient_fraction=coefficient_fraction,
        data_bits=data_bits,
        rounding=rounding,
    )
    return Case(divergence, source, fraction, chosen)


def source_operator(n: int, divergence: str) -> np.ndarray:
    """The exact linear map from slopes to the source in px, (n · n, slopes)."""
    step, weight = (1, 0.5) if divergence == "central" else (0, 1.0)
    found = np.zeros((n, n, n + 2, n + 2, 2))
    for i in range(n):
        for j in range(n):
            found[i, j, i + 1, j + 1 + step, 0] += weight
            found[i, j, i + 1, j, 0] -= weight
            found[i, j, i + 1 + step, j + 1, 1] += weight
            found[i, j, i, j + 1, 1] -= weight
    return found.reshape(n * n, -1)


def check_worst_slopes(
    case: Case,
    operators: dict[str, np.ndarray],
    trace: Callable[[Case, np.ndarray], dict[str, np.ndarray]],
    *,
    exact: bool,
    last_share: float,
) -> None:
    """The slopes that drive a word furthest come close to its bound, and no slopes drive one beyond.

    operators : by stage, the exact linear map from the source to its words, (n · n, n · n)
    trace : every word by stage, (frames, n, n), of slopes (frames, n + 2, n + 2, 2)
    exact : whether the words are so fine that they come to 0.999 of each bound, those of the last stage to
        `last_share`: there the worst slopes' pixel need not be the worst constant's
    """
    n = len(case.source.offset)
    to_source = source_operator(n, case.divergence)
    constant = case.source.offset.ravel() * 2.0**-case.fraction
    formats = {stage.name: stage for stage in case.solver.stages}
    assert tuple(formats) == tuple(operators)
    for name, operator in operators.items():
        rows = operator @ to_source
        away = -(operator @ constant)
        worst = np.abs(rows).sum(axis=1) * LIMIT * 2.0**-SLOPE_FRACTION + np.abs(away)
        # One frame for each word of the stage: the slopes that drive it furthest.
        slopes = LIMIT * np.sign(rows) * np.where(away < 0, -1, 1)[:, None]
        words = trace(case, np.rint(slopes).astype(np.int64).reshape(n * n, n + 2, n + 2, 2))
        assert np.abs(words["source"]).max() <= case.source.bound
        for stage, word in formats.items():
            unit = 2.0**-word.format.fraction
            assert np.abs(words[stage]).max() <= word.format.limit, stage
            assert np.abs(words[stage]).max() * unit <= word.bound_px + unit, stage
        k = worst.argmax()
        reached = abs(words[name].reshape(n * n, -1)[k, k]) * 2.0 ** -formats[name].format.fraction
        assert reached == pytest.approx(worst[k], rel=0.02), name
        if exact:
            share = last_share if name == "row_inverse" else 0.999
            assert reached >= share * formats[name].bound_px, name
        assert formats[name].bound_px >= worst[k] * (1 - 1e-4), name


def check_random_slopes(case: Case, trace: Callable[[Case, np.ndarray], dict[str, np.ndarray]]) -> None:
    """Saturated slopes of random signs, pixel by pixel and in blocks, stay inside every word."""
    n, rng = len(case.source.offset), np.random.default_rng(3)
    size = n + 2
    signs = rng.choice([-LIMIT, LIMIT], (200, size, size, 2))
    blocks = rng.choice([-LIMIT, LIMIT], (200, size // 4, size // 4, 2)).repeat(4, axis=1).repeat(4, axis=2)
    words = trace(case, np.concatenate([signs, blocks]))
    for stage in case.solver.stages:
        assert np.abs(words[stage.name]).max() <= stage.format.limit


def smooth_surface_error(case: Case) -> float:
    """The largest depth error against the float solver, as a share of the depth of a surface some 10 px
    high."""
    size = len(case.source.offset) + 2
    v, u = np.indices((size, size))
    slopes = np.stack([1.2 * np.cos(u / 6) + 0.3 * np.sin(v / 3), -0.9 * np.sin(v / 7)], axis=-1)
    words = np.rint(slopes * 2**SLOPE_FRACTION).astype(np.int64)
    offset = case.source.offset * 2.0**-case.fraction
    expected = solve(source_of(words * 2.0**-SLOPE_FRACTION, case.divergence) - offset)
    found = case.solver.depth_format.to_float(case.solver(case.source(words[None]))[0])
    assert np.abs(expected).max() > 5
    return float(np.abs(found - expected).max() / np.abs(expected).max())
