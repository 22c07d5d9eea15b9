"""The Poisson solver of a sine transform and recurrences over the rows, in float64."""

import numpy as np

from fastac.models.emulator.exactness import (
    added,
    folded_transform,
    largest_word,
    require_exact,
    round_in_place,
)
from fastac.models.integer.tridiagonal import Recurrence, TridiagonalSolver
from fastac.models.loops.sines import fold_rows, unfold_rows


class RecurrenceTables:
    """`tridiagonal.TridiagonalSolver` in float64: recurrences over rows, of all modes and frames at once."""

    frame_axis = 1

    def __init__(self, solver: TridiagonalSolver):
        self.row_forward = folded_transform("row_forward", solver.row_forward)
        self.row_inverse = folded_transform("row_inverse", solver.row_inverse)
        elimination, substitution = solver.elimination, solver.substitution
        reach = largest_word(elimination.output_width) + largest_word(elimination.input_width)
        self.elimination = self._coefficients("elimination", elimination, reach)
        y = largest_word(substitution.input_width) << (substitution.shift - substitution.drop)
        self.substitution = self._coefficients(
            "substitution", substitution, largest_word(substitution.output_width), y
        )
        order = self.row_forward.order
        self.elimination, self.substitution = self.elimination[:, order], self.substitution[:, order]
        self.unit = 2.0**-substitution.drop
        self.halves = [added(stage.rounding) for stage in solver.parts.values()]

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
