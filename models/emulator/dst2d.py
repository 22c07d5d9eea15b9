"""The Poisson solver of two sine transforms and a division, in float64."""

import numpy as np

from fastac.models.emulator.exactness import added, folded_transform, largest_word, require_exact
from fastac.models.integer.dst2d import Solver
from fastac.models.integer.words import half_unit
from fastac.models.loops.sines import fold_columns, fold_rows, round_and_scale, unfold_columns, unfold_rows


class TransformTables:
    """`dst2d.Solver` in float64: transforms of rows and columns, one frame after another."""

    frame_axis = 0

    def __init__(self, solver: Solver):
        division = solver.division
        bound = largest_word(division.input_width) * int(division.mantissa.max())
        require_exact("division", bound + int(half_unit(division.shift.max(), division.rounding)))
        self.row_forward = folded_transform("row_forward", solver.row_forward)
        self.column_forward = folded_transform("column_forward", solver.column_forward)
        self.column_inverse = folded_transform("column_inverse", solver.column_inverse)
        self.row_inverse = folded_transform("row_inverse", solver.row_inverse)
        order = self.row_forward.order
        reciprocal = -division.mantissa * 2.0**-division.shift
        self.reciprocal = np.ascontiguousarray(reciprocal[order][:, order])
        self.halves = [added(stage.rounding) for stage in solver.parts.values()]

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
