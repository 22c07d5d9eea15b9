"""A frame's phases, and compiled loops of the Poisson solvers, as tasks of a team: what the emulator and the
float pipeline share."""

import numpy as np

from fastac.models.loops.memory import aligned_zeros
from fastac.models.loops.pixels import source as source_rows
from fastac.models.loops.sines import (
    BAND,
    columns_product,
    fold_columns,
    fold_rows,
    round_and_scale,
    rows_product,
    unfold_columns,
)
from fastac.models.loops.tasks import done, take, tasks, wait
from fastac.store.compiled_loops import compiled

_inlined = compiled(inline="always")

PIXELS, ROWS, COLUMNS, SOLUTION = range(4)
"""Phases of a frame: slopes; the transform of the source's rows; what is done to each mode; the solution's
rows."""
TASK_PIXELS = 256
"""Pixels of a task, in whole rows."""


def rows_each(width: int) -> int:
    """Rows of a frame that are a task."""
    return max(1, TASK_PIXELS // width)


@_inlined
def transform_source(board, member, source, sine, modes):
    """Phase ROWS: from slopes (2, H · W) to the modes of each row of the source; see `pixels.source`.

    source : slopes; N, rows and columns of the source; `ahead`, `scale` and `offset` of `pixels.source`
    sine : `FoldedSine.rows`; modes : `FoldedSine.memory`
    """
    slopes, size, ahead, scale, offset = source
    half = sine.shape[1] * sine.shape[3]
    given = np.empty(BAND * size, offset.dtype)
    folded = aligned_zeros(BAND, modes.shape[1], modes)
    wait(board, PIXELS)
    band = take(board, ROWS, member)
    while band < tasks(board, ROWS):
        first = band * BAND
        found = given[: min(BAND, size - first) * size]
        source_rows(slopes, size + 2, first, ahead, scale, offset, found)
        fold_rows(found, size, half, folded)
        rows_product(folded, sine, modes[first : first + BAND])
        done(board, ROWS)
        band = take(board, ROWS, member)


@_inlined
def divide_modes(board, member, sine, sine_back, factors, halves, size, modes):
    """Phase COLUMNS: transform each column of modes, multiply it by its factors, and transform it back.

    sine, sine_back : `FoldedSine.columns` and `columns_back`
    factors : (blocks, 2 halves, columns), by modes along both axes, see `FoldedSine.in_blocks`
    halves : what is added before the floors of the modes given, transformed, multiplied and transformed back;
        None: no rounding
    """
    rows, columns, multiplied, back = halves
    _, rows_folded, wide = factors.shape
    a, b = aligned_zeros(rows_folded, wide, modes), aligned_zeros(rows_folded, wide, modes)
    wait(board, ROWS)
    block = take(board, COLUMNS, member)
    while block < tasks(board, COLUMNS):
        fold_columns(modes, block * wide, size, rows, a)
        columns_product(sine, a, b)
        round_and_scale(b, columns, factors[block], multiplied)
        columns_product(sine_back, b, a)
        unfold_columns(a, back, modes, block * wide, size)
        done(board, COLUMNS)
        block = take(board, COLUMNS, member)
