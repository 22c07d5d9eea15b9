"""The Poisson solver of a sine transform and recurrences over the rows, in float64."""

import numpy as np

from fastac.models.emulator.exactness import added, folded_transform, largest_word, require_exact
from fastac.models.emulator.stages import find_depth, find_slopes
from fastac.models.integer.tridiagonal import Recurrence, TridiagonalSolver
from fastac.models.loops.poisson import COLUMNS, ROWS, transform_source
from fastac.models.loops.tasks import done, take, tasks, wait
from fastac.store.compiled_loops import compiled


@compiled()
def _recur(board, member, elimination, substitution, unit, halves, modes):
    """Phase COLUMNS: elimination down the rows of each mode, and substitution up.

    elimination, substitution : (blocks, N, columns), see `FoldedSine.in_blocks`; unit : 2**−drop
    halves : what is added before the floors of the transformed rows, of elimination and of substitution
    """
    transformed, down, up = halves
    _, size, wide = elimination.shape
    held = np.empty(wide)
    wait(board, ROWS)
    block = take(board, COLUMNS, member)
    while block < tasks(board, COLUMNS):
        first = block * wide
        for j in range(wide):
            held[j] = 0
        for i in range(size):
            row, c = modes[i, first : first + wide], elimination[block, i]
            for j in range(wide):
                held[j] = np.floor((held[j] - np.floor(row[j] + transformed)) * c[j] + down)
                row[j] = held[j]
        for j in range(wide):
            held[j] = 0
        for i in range(size - 1, -1, -1):
            row, c = modes[i, first : first + wide], substitution[block, i]
            for j in range(wide):
                held[j] = np.floor((row[j] * unit + up) + c[j] * held[j])
                row[j] = held[j]
        done(board, COLUMNS)
        block = take(board, COLUMNS, member)


@compiled()
def _emulate(board, member, bell, k, before, source, tables, modes, behind):
    rows, elimination, substitution, unit, halves, rows_back, last = tables
    find_slopes(board, member, bell, k, before)
    transform_source(board, member, source, rows, modes)
    _recur(board, member, elimination, substitution, unit, halves, modes)
    find_depth(board, member, bell, k, source[1], modes, rows_back, last, behind)


class RecurrenceTables:
    """`tridiagonal.TridiagonalSolver` in float64; see `solvers.SOLVERS`."""

    emulate = staticmethod(_emulate)

    def __init__(self, solver: TridiagonalSolver):
        row_forward = folded_transform("row_forward", solver.row_forward)
        row_inverse = folded_transform("row_inverse", solver.row_inverse)
        elimination, substitution = solver.elimination, solver.substitution
        reach = largest_word(elimination.output_width) + largest_word(elimination.input_width)
        down = self._coefficients("elimination", elimination, reach)
        y = largest_word(substitution.input_width) << (substitution.shift - substitution.drop)
        up = self._coefficients("substitution", substitution, largest_word(substitution.output_width), y)
        *halves, last = (added(stage.rounding) for stage in solver.parts.values())
        self.sine = row_forward
        self.tables = (
            row_forward.rows,
            row_forward.in_blocks(down),
            row_forward.in_blocks(up),
            2.0**-substitution.drop,
            (*halves,),
            row_inverse.rows_back,
            last,
        )

    @staticmethod
    def _coefficients(name: str, recurrence: Recurrence, reach: int, known: int = 0) -> np.ndarray:
        largest = int(recurrence.coefficient.max())
        require_exact(name, largest * reach + known + recurrence.half_unit)
        return recurrence.coefficient * 2.0**-recurrence.shift
