"""The Poisson solver of two sine transforms and a division, in float64."""

from fastac.models.emulator.exactness import added, folded_transform, largest_word, require_exact
from fastac.models.emulator.stages import find_depth, find_slopes
from fastac.models.integer.dst2d import Solver
from fastac.models.integer.words import half_unit
from fastac.models.loops.poisson import divide_modes, transform_source
from fastac.store.compiled_loops import compiled


@compiled()
def _emulate(board, member, bell, k, before, source, tables, modes, behind):
    rows, columns, columns_back, factors, halves, rows_back, last = tables
    find_slopes(board, member, bell, k, before)
    size = source[1]
    transform_source(board, member, source, rows, modes)
    divide_modes(board, member, columns, columns_back, factors, halves, size, modes)
    find_depth(board, member, bell, k, size, modes, rows_back, last, behind)


class TransformTables:
    """`dst2d.Solver` in float64; see `solvers.SOLVERS`."""

    emulate = staticmethod(_emulate)

    def __init__(self, solver: Solver):
        division = solver.division
        bound = largest_word(division.input_width) * int(division.mantissa.max())
        require_exact("division", bound + int(half_unit(division.shift.max(), division.rounding)))
        row_forward = folded_transform("row_forward", solver.row_forward)
        column_forward = folded_transform("column_forward", solver.column_forward)
        column_inverse = folded_transform("column_inverse", solver.column_inverse)
        row_inverse = folded_transform("row_inverse", solver.row_inverse)
        reciprocal = row_forward.by_modes((-division.mantissa * 2.0**-division.shift).T).T
        *halves, last = (added(stage.rounding) for stage in solver.parts.values())
        self.sine = row_forward
        self.tables = (
            row_forward.rows,
            column_forward.columns,
            column_inverse.columns_back,
            row_forward.in_blocks(reciprocal),
            (*halves,),
            row_inverse.rows_back,
            last,
        )
