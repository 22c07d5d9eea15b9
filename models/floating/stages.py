"""The float pipeline's compiled stages before and behind the Poisson solver, as tasks of a team
(`loops/tasks.py`).

Each task writes its share of the force into its own row of `shares` (tasks, axes), so that sums are in the
same order whoever did the tasks. Places are those of `Result`, flat behind the axis of frames; what is not
wanted has no elements.
"""

import numpy as np

from fastac.models.loops.dots import bridge, dark_pixels
from fastac.models.loops.memory import aligned_zeros
from fastac.models.loops.network_kernel import block_memory, forward
from fastac.models.loops.pixels import interleave_slopes, limited_slopes, unit_normals
from fastac.models.loops.poisson import COLUMNS, PIXELS, SOLUTION, divide_modes, transform_source
from fastac.models.loops.sines import BAND, rows_product, unfold_rows
from fastac.models.loops.tasks import begin, done, linger, take, tasks, wait
from fastac.models.loops.weights import weigh, weigh_terms
from fastac.store.compiled_loops import compiled

_compiled = compiled()
_inlined = compiled(inline="always")

SHORTEST = np.float32(1e-12)
"""Length below which a normal is not scaled to one."""


@_inlined
def find_slopes(board, member, bell, k, before):
    """Phase PIXELS: from a frame to its slopes, and to what else follows from its pixels alone.

    k : the frame's number; the others are in `before`, in this order:
    frames : (frames, H, W, C) uint8; seen : `FrameNetwork.seen` of them
    network : `FrameNetwork.tables`
    settings : the largest slope; rows of a task; whether slopes are wanted; whether no other phase follows
    bridged : thresholds of darkness, and how far a bridge reaches, or 0
    slopes : (2, H · W)
    force : slopes at rest (2, H · W), and weights (axes, 2, H · W) of their change; without them, no elements
    found : `shares`, and the places of normals and slopes
    """
    frames, seen, network, settings, bridged, slopes, force, found = before
    begin(board, member, bell)
    limit, each, wants_slopes, is_last = settings
    threshold, reach = bridged
    at_rest, weight = force
    shares, normals, slopes_found = found
    _, height, width, _ = frames.shape
    normal, change = np.empty((3, each * width), np.float32), np.empty(each * width, np.float32)
    rest, hidden, _, tops, _, last = network
    memory = block_memory(rest, hidden, tops, last, normal)
    dark, over = np.empty((each, width), np.bool_), np.empty((2, 0), np.bool_)
    task = take(board, PIXELS, member)
    while task < tasks(board, PIXELS):
        first = task * each
        rows = min(each, height - first)
        start, stop = first * width, (first + rows) * width
        forward(seen[k], *network, memory, start, stop, normal)
        if normals.size:
            unit_normals(normal, SHORTEST, normals[k, 3 * start : 3 * stop])
        if wants_slopes:
            p, q = slopes[0, start:stop], slopes[1, start:stop]
            limited_slopes(normal[0], normal[2], limit, p)
            limited_slopes(normal[1], normal[2], limit, q)
            if reach:
                dark_pixels(frames[k], threshold, first, dark[:rows])
                bridge(dark[:rows], reach, p, q, over)
            if slopes_found.size:
                interleave_slopes(p, q, np.float32(1), slopes_found[k, 2 * start : 2 * stop])
            if len(weight):
                part = change[: stop - start]
                for axis in range(len(weight)):
                    shares[task, axis] = 0
                for component in range(2):
                    values, known = slopes[component, start:stop], at_rest[component, start:stop]
                    for j in range(len(part)):
                        part[j] = values[j] - known[j]
                    for axis in range(len(weight)):
                        shares[task, axis] += weigh(part, weight[axis, component, start:])
        done(board, PIXELS)
        task = take(board, PIXELS, member)
    if is_last:
        linger(board, member, bell)


@_inlined
def solve(board, member, bell, k, behind):
    """Phases ROWS to SOLUTION: from slopes to the displacement, and to what follows from it.

    k : the frame's number; the others are in `behind`, in this order:
    source : see `transform_source`
    sine : `FoldedSine.rows`, `columns`, `columns_back`, `rows_back`, and factors as `divide_modes` takes them
    settings : N; whether negative displacements count as zero
    rest_mm : (H · W,) the depth at rest
    bends : of the force's terms; weight : (axes, terms, N · N); without a force, no elements
    found : `shares`, and the places of depth, displacement, and the displacement as it counts, all in mm
    """
    source, sine, modes, settings, rest_mm, bends, weight, found = behind
    rows, columns, columns_back, rows_back, factors = sine
    size, clamp = settings
    shares, depth_mm, displacement_mm, counted_mm = found
    transform_source(board, member, source, rows, modes)
    divide_modes(board, member, columns, columns_back, factors, (None, None, None, None), size, modes)
    half, partial = rows_back.shape[1] * rows_back.shape[3], aligned_zeros(BAND, modes.shape[1], modes)
    part, width = np.empty(BAND * size, modes.dtype), size + 2
    wait(board, COLUMNS)
    band = take(board, SOLUTION, member)
    while band < tasks(board, SOLUTION):
        first = band * BAND
        start, stop = first * size, min(first + BAND, size) * size
        x = part[: stop - start]
        rows_product(modes[first : first + BAND], rows_back, partial)
        unfold_rows(partial, half, None, size, x)
        for j in range(displacement_mm[k, start:stop].size):
            displacement_mm[k, start + j] = x[j]
        if depth_mm.size:
            above = 0 if band == 0 else (first + 1) * width
            below = len(rest_mm) if stop == size * size else (first + BAND + 1) * width
            for j in range(above, below):
                depth_mm[k, j] = rest_mm[j]
            for j in range(stop - start):
                depth_mm[k, (first + 1 + j // size) * width + 1 + j % size] -= x[j]
        if clamp:
            for j in range(len(x)):
                x[j] = max(x[j], np.float32(0))
        for j in range(counted_mm[start:stop].size):
            counted_mm[start + j] = x[j]
        if len(weight):
            weigh_terms(x, bends, weight, start, shares[band])
        done(board, SOLUTION)
        band = take(board, SOLUTION, member)
    linger(board, member, bell)


@_compiled
def find_all(board, member, bell, k, before, behind):
    """All phases of a frame: `find_slopes` and `solve`. In one call, for between two a thread would need
    Python's lock, and wait for another that has it."""
    find_slopes(board, member, bell, k, before)
    solve(board, member, bell, k, behind)


@_compiled
def slopes_alone(board, member, bell, k, before):
    """`find_slopes`, where no other phase follows."""
    find_slopes(board, member, bell, k, before)


@_compiled
def depth_alone(board, member, bell, k, behind):
    """`solve`, of slopes that are there."""
    solve(board, member, bell, k, behind)


@_compiled
def finish(board, phase):
    """Wait for a frame's last phase."""
    wait(board, phase)
