"""The integer Poisson solvers in float64: tables carry each stage's shift, so that any rounding is a floor.

A power of two only moves the exponent: what is an integer below 2**53 times 2**−shift is exact in float64,
and so is every partial sum, in whatever order BLAS adds.
"""

import numpy as np

from fastac.models.integer.dst2d import Solver
from fastac.models.integer.solver import SineTransform
from fastac.models.integer.tridiagonal import Recurrence, TridiagonalSolver
from fastac.models.integer.words import NEAREST, half_unit
from fastac.models.loops.sines import (
    FoldedSine,
    fold_columns,
    fold_rows,
    is_foldable,
    round_and_scale,
    unfold_columns,
    unfold_rows,
)

EXACT = 1 << 53
EXACT_FLOAT32 = 1 << 24
"""Below these bounds every integer is exact, in float64 and in float32."""


class NotExactError(ValueError):
    """Tables whose integers float64 might not hold, or that are not as the emulator wants them."""


def require_exact(name: str, bound: int) -> None:
    """Raise NotExactError where integers of up to `bound` are not all exact in float64."""
    if bound >= EXACT:
        raise NotExactError(f"{name} bound {bound}: integers of 2**53 and more are not exact in float64")


def added(rounding: str) -> float:
    """`fixed.half_unit` once the shift is in the table; a floor's 0 makes +0 of −0, as with integers."""
    return 0.5 if rounding == NEAREST else 0.0


def round_in_place(x: np.ndarray, half: float = 0.5) -> np.ndarray:
    """`floor(x + half)`: what `fixed.round_shift` does once the shift is in the table; see `added`."""
    np.add(x, half, out=x)
    return np.floor(x, out=x)


def _transform(name: str, transform: SineTransform) -> FoldedSine:
    require_exact(name, transform.accumulator_bound)
    if not is_foldable(transform.matrix):
        raise NotExactError(f"{name} matrix: expected rows even and odd about the middle in turn")
    return FoldedSine(transform.matrix * 2.0**-transform.shift)


def _largest(width: int) -> int:
    return 1 << (width - 1)


class TransformTables:
    """`bounds.Solver`: transforms of rows and columns, one frame after another."""

    frame_axis = 0

    def __init__(self, solver: Solver):
        division = solver.division
        bound = _largest(division.input_width) * int(division.mantissa.max())
        require_exact("division", bound + int(half_unit(division.shift.max(), division.rounding)))
        self.row_forward = _transform("row_forward", solver.row_forward)
        self.column_forward = _transform("column_forward", solver.column_forward)
        self.column_inverse = _transform("column_inverse", solver.column_inverse)
        self.row_inverse = _transform("row_inverse", solver.row_inverse)
        order = self.row_forward.order
        reciprocal = -division.mantissa * 2.0**-division.shift
        self.reciprocal = np.ascontiguousarray(reciprocal[order][:, order])
        stages = ("row_forward", "column_forward", "division", "column_inverse", "row_inverse")
        self.halves = [added(getattr(solver, name).rounding) for name in stages]

    def solve(self, x: np.ndarray) -> None:
        """Sources (frames, N, N) to solutions, in place."""
        a, b = np.empty((2, *x.shape[1:]))
        rows, columns, division, columns_back, rows_back = self.halves
        for frame in x:
            fold_rows(frame, a)
            self.row_forward.rows(a, b)
            fold_columns(b, rows, a)
            self.column_forward.columns(a, b)
            round_and_scale(b, columns, self.reciprocal, division)
            self.column_inverse.columns_back(b, a)
            unfold_columns(a, columns_back, b)
            self.row_inverse.rows_back(b, a)
            unfold_rows(a, rows_back, frame)


class RecurrenceTables:
    """`tridiagonal.TridiagonalSolver`: recurrences over the rows, of all modes and frames at once."""

    frame_axis = 1

    def __init__(self, solver: TridiagonalSolver):
        self.row_forward = _transform("row_forward", solver.row_forward)
        self.row_inverse = _transform("row_inverse", solver.row_inverse)
        elimination, substitution = solver.elimination, solver.substitution
        reach = _largest(elimination.output_width) + _largest(elimination.input_width)
        self.elimination = self._coefficients("elimination", elimination, reach)
        y = _largest(substitution.input_width) << (substitution.shift - substitution.drop)
        self.substitution = self._coefficients(
            "substitution", substitution, _largest(substitution.output_width), y
        )
        order = self.row_forward.order
        self.elimination, self.substitution = self.elimination[:, order], self.substitution[:, order]
        self.unit = 2.0**-substitution.drop
        stages = (solver.row_forward, elimination, substitution, solver.row_inverse)
        self.halves = [added(stage.rounding) for stage in stages]

    @staticmethod
    def _coefficients(name: str, recurrence: Recurrence, reach: int, known: int = 0) -> np.ndarray:
        largest = int(recurrence.coefficient.max())
        require_exact(name, largest * reach + known + recurrence.half_unit)
        return recurrence.coefficient * 2.0**-recurrence.shift

    def solve(self, x: np.ndarray) -> None:
        """Sources (N, frames, N), row by frame by column, to solutions, in place."""
        flat = x.reshape(-1, x.shape[-1])
        rows, down, up, rows_back = self.halves
        folded, modes = np.empty((2, *flat.shape))
        fold_rows(flat, folded)
        self.row_forward.rows(folded, modes)
        r = round_in_place(modes, rows).reshape(x.shape)
        y = 0.0
        for row, c in zip(r, self.elimination, strict=True):
            np.subtract(y, row, out=row)
            np.multiply(row, c, out=row)
            y = round_in_place(row, down)
        np.multiply(r, self.unit, out=r)
        np.add(r, up, out=r)
        z, product = 0.0, np.empty(r.shape[1:])
        for row, c in zip(r[::-1], self.substitution[::-1], strict=True):
            np.multiply(c, z, out=product)
            np.add(row, product, out=row)
            z = np.floor(row, out=row)
        self.row_inverse.rows_back(modes, folded)
        unfold_rows(folded, rows_back, flat)
