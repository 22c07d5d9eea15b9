"""The DST + tridiagonal Poisson solver in integers, and the word formats that follow from its worst cases.

After the DST-I of the rows every mode n is a tridiagonal system over the rows i, with a zero boundary:
z[i−1] + z[i+1] − d_n z[i] = r[i], d_n = 4 − 2cos(πn/(N+1)) > 2. Thomas's algorithm solves it:

    c[1] = 1/d            c[i] = 1/(d − c[i−1])              all 0 < c[i] < 1
    y[1] = −c[1] r[1]     y[i] = c[i] (y[i−1] − r[i])        elimination, while rows stream in
    z[N] = y[N]           z[i] = y[i] + c[i] z[i+1]          substitution, last row to first

and the DST-I of the rows of z is the solution. c[i] converges to c = (d − sqrt(d² − 4))/2 by a factor c² a
row, so that only low modes need a coefficient per row for long.
Source: Press et al., "Numerical Recipes", 3rd ed., sections 2.4 and 20.4.1.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from fastac.models.integer.bounds import (
    GUARD_BITS,
    Stage,
    between_rows,
    coefficients,
    green_norm,
    stencil_norms,
)
from fastac.models.integer.laplacian import STENCILS, eigenvalues
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.words import (
    LARGEST_ERROR,
    NEAREST,
    Fixed,
    check_rounding,
    fit,
    half_unit,
    round_shift,
)

COEFFICIENT_BITS = 17
"""The most that, unsigned, share a DSP48E2 through its signed 18-bit port."""


@dataclass(frozen=True, eq=False)
class Recurrence:
    """What elimination and substitution share: `coefficient` · 2**−`shift` is c[i] of each row and mode."""

    coefficient: np.ndarray  # (N, N), row by mode
    shift: int
    input_width: int
    output_width: int
    rounding: str = field(default=NEAREST, kw_only=True)
    downwards: ClassVar[bool]
    """Whether it runs from the first row to the last."""

    def __post_init__(self):
        check_rounding(self.rounding)
        n = len(self.coefficient)
        if self.coefficient.shape != (n, n):
            raise ValueError(f"coefficient {self.coefficient.shape}: expected square")
        if not 1 <= self.shift <= COEFFICIENT_BITS:
            raise ValueError(f"shift {self.shift}: expected 1 to {COEFFICIENT_BITS}")
        low, high = int(self.coefficient.min()), int(self.coefficient.max())
        if low < 0 or high >> self.shift:
            raise ValueError(f"coefficient {low} to {high}: expected 0 to {(1 << self.shift) - 1}")

    @property
    def size(self) -> int:
        return len(self.coefficient)

    @property
    def half_unit(self) -> int:
        """What rounding adds to a sum before the shift; 0 with a floor."""
        return int(half_unit(self.shift, self.rounding))

    @cached_property
    def varying(self) -> np.ndarray:
        """(N,): the row from which on a mode's coefficient stays the same; a table ends there."""
        changes = np.diff(self.coefficient, axis=0, prepend=-1) != 0
        return self.size - 1 - changes[::-1].argmax(axis=0)


@dataclass(frozen=True, eq=False)
class Elimination(Recurrence):
    """`y[i] = round_shift(coefficient[i] · (y[i−1] − r[i]), shift, rounding)` down the rows.

    y before the first row is 0. Input and output have the same fraction.
    """

    downwards = True

    def __call__(self, r: np.ndarray) -> np.ndarray:
        """Row-transformed sources (..., N, N), rows by modes, to y of the same shape."""
        y, above = np.empty(r.shape, np.int64), 0
        for i, c in enumerate(self.coefficient):
            y[..., i, :] = above = round_shift(c * (above - r[..., i, :]), self.shift, self.rounding)
        return y


@dataclass(frozen=True, eq=False)
class Substitution(Recurrence):
    """`z[i] = round_shift(coefficient[i] · z[i+1] + (y[i] << (shift − drop)), shift, rounding)` up the rows.

    z behind the last row is 0; z has `drop` fractional bits fewer than y.
    """

    drop: int
    downwards = False

    def __post_init__(self):
        super().__post_init__()
        if not 0 <= self.drop <= self.shift:
            raise ValueError(f"drop {self.drop}: expected 0 to shift = {self.shift}")

    def __call__(self, y: np.ndarray) -> np.ndarray:
        """Eliminated rows (..., N, N), first to last, to the modes of the solution in the same order."""
        z, below = np.empty(y.shape, np.int64), 0
        for i in reversed(range(self.size)):
            total = self.coefficient[i] * below + (y[..., i, :] << (self.shift - self.drop))
            z[..., i, :] = below = round_shift(total, self.shift, self.rounding)
        return z


def thomas_coefficients(size: int, fraction: int) -> np.ndarray:
    """c[i] of every row and mode in units of 2**−fraction, (N, N): the nearest integer.

    Where c[i] lies within half a unit of the mode's limit, the limit's nearest integer stands for it.
    """
    d = 4 - 2 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1))
    limit = (d - np.sqrt(d**2 - 4)) / 2
    exact, c = [], np.zeros(size)
    for _ in range(size):
        exact.append(c := 1 / (d - c))
    scaled, at_limit = np.array(exact) * 2.0**fraction, limit * 2.0**fraction
    return np.rint(np.where(np.abs(scaled - at_limit) <= 0.5, at_limit, scaled)).astype(np.int64)


def row_operators(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The recurrences' ways through the rows, each (mode, i, k), for real coefficients (row, mode).

    down[n, i, k] = Π c[j] over k < j <= i: from a disturbance of y[k] to y[i], and 0 for k > i.
    up[n, i, k] = Π c[j] over i <= j < k: from a disturbance of z[k] to z[i], and 0 for k < i.
    """
    n = len(c)
    down, up = np.zeros((n, n, n)), np.zeros((n, n, n))
    for i in range(n):
        down[:, i, i] = up[:, i, i] = 1
        if i:
            down[:, i, :i] = c[i][:, None] * down[:, i - 1, :i]
            up[:, :i, i] = up[:, :i, i - 1] * c[i - 1][:, None]
    return down, up


@dataclass(frozen=True, eq=False)
class TridiagonalSolver(IntegerSolver):
    """The integer solver: two transforms around two recurrences, with each word's worst case."""

    row_forward: SineTransform
    elimination: Elimination
    substitution: Substitution
    row_inverse: SineTransform
    stages: tuple[Stage, ...]

    @classmethod
    def fitted(
        cls,
        *,
        offset: np.ndarray,
        source: Fixed,
        slope_limit: float,
        divergence: str,
        coefficient_fraction: int,
        data_bits: int,
        rounding: str = NEAREST,
    ) -> "TridiagonalSolver":
        """See `IntegerSolver.fitted`.

        A word's worst case is the L1 norm of the integer tables' own way from the slopes to it, times the
        slopes' limit, plus the constant, plus every rounding before it, times the L1 norm of that rounding's
        way. A recurrence carries its own roundings along: in y[i] they add up to what one is at most, half a
        unit or with a floor a whole one, times Σ_k Π c[j] over k < j <= i, 38 times in the lowest mode of
        N = 126.
        """
        check_rounding(rounding)
        n = len(offset)
        matrix = coefficients(n, coefficient_fraction)
        s = matrix * 2.0**-coefficient_fraction
        table = thomas_coefficients(n, coefficient_fraction)
        c = table * 2.0**-coefficient_fraction
        down, up = row_operators(c)
        eliminate = down * c.T[:, None, :]  # from −r to y
        solve = up @ eliminate  # from −r to z
        along, across = stencil_norms(s, divergence)
        weight = STENCILS[divergence].norm
        constant = source.to_float(offset) @ s  # (i, n)
        stages: list[Stage] = []

        def reached(operators: np.ndarray) -> np.ndarray:
            """What slopes and constant reach through operators (n, i, k), (i, n)."""
            along_rows, across_rows = stencil_norms(operators, divergence)
            slopes = across_rows * along[:, None] + along_rows * across[:, None]
            return (slope_limit * slopes + np.abs(np.einsum("nik,kn->ni", operators, constant))).T

        def ways(operators: np.ndarray) -> np.ndarray:
            """Σ over the rows k of a rounding's ways (n, i, k), (i, n)."""
            return operators.sum(axis=2).T

        def choose(name: str, bound: np.ndarray, own: np.ndarray | float, fraction: int) -> float:
            """Fix a word that holds `bound` and `own` of its own roundings; returns the largest, in px."""
            for bits in range(fraction, -1, -1):
                worst = float((bound + own * (LARGEST_ERROR[rounding] * 2.0**-bits)).max())
                word = fit(worst, width=data_bits, fraction=bits)
                if word.fraction == bits:
                    break
            stages.append(Stage(name, worst, word))
            return LARGEST_ERROR[rounding] * 2.0**-word.fraction

        fraction = source.fraction + GUARD_BITS
        rows = slope_limit * (along + weight * across)[None, :] + np.abs(constant)
        choose("row_forward", rows, 0.0, fraction)
        # Rows and y share their fraction: y − r is then one bit wider, and fits the multiplier's port.
        own = ways(eliminate) + ways(down)
        error = choose("elimination", reached(eliminate), own, stages[0].format.fraction)
        y = stages[1].format
        r = fit(float(rows.max()), width=data_bits, fraction=y.fraction)
        stages[0] = Stage("row_forward", stages[0].bound_px, r)
        disturbed = error * ways(solve + up @ down)
        error = choose("back_substitution", reached(solve) + disturbed, ways(up), y.fraction)
        z = stages[2].format
        disturbed += error * ways(up)
        # Of the way from slopes to solution the ideal one is symmetric, so quick to search; to it comes what
        # the rounded coefficients change at most: both stencils' weights times Σ over modes and rows of it.
        change = np.abs(solve - between_rows(s, -1 / eigenvalues(n))).sum(axis=2).T * across
        norm = green_norm(s, -1 / eigenvalues(n), divergence)
        norm += 2 * weight * float((change @ np.abs(s)).max())
        still = np.abs(np.einsum("nik,kn->in", solve, constant) @ s)
        choose("row_inverse", slope_limit * norm + still + disturbed @ np.abs(s), 0.0, fraction)

        depth = stages[3].format
        shift = coefficient_fraction
        return cls(
            row_forward=SineTransform(
                matrix, shift + source.fraction - r.fraction, source.width, r.width, rounding
            ),
            elimination=Elimination(table, shift, r.width, y.width, rounding=rounding),
            substitution=Substitution(
                table, shift, y.width, z.width, y.fraction - z.fraction, rounding=rounding
            ),
            row_inverse=SineTransform(
                matrix, shift + z.fraction - depth.fraction, z.width, depth.width, rounding
            ),
            stages=tuple(stages),
        )

    def mode_operators(self) -> dict[str, np.ndarray]:
        c = self.elimination.coefficient * 2.0**-self.elimination.shift
        down, up = row_operators(c)
        eliminate = down * c.T[:, None, :]
        return {"elimination": eliminate, "substitution": up @ eliminate}
