"""The emulator's compiled stages before and behind the Poisson solver, as tasks of a team (`loops/tasks.py`).

Each counts what it finds in the task's own row of `counts` (tasks, columns) int64 and `shares` (tasks, axes)
of the force: no thread waits for another's sums. These are integers, in float64 too, exact in whatever order.
Places are those of `Result`, flat behind the axis of frames; what is not wanted has no elements.
"""

import numpy as np

from fastac.models.loops.dots import bridge, dark_pixels, follow
from fastac.models.loops.measures import measure
from fastac.models.loops.memory import aligned_zeros
from fastac.models.loops.network_kernel import block_memory, forward
from fastac.models.loops.pixels import (
    depth_and_displacement,
    displacement_words,
    framed_depth,
    interleave_normals,
    interleave_slopes,
    slope_words,
    unit_normals,
)
from fastac.models.loops.poisson import COLUMNS, PIXELS, SOLUTION
from fastac.models.loops.sines import BAND, rows_product, unfold_rows
from fastac.models.loops.tasks import begin, done, linger, take, tasks, wait
from fastac.models.loops.weights import weigh, weigh_terms
from fastac.store.compiled_loops import compiled

_compiled = compiled()
_inlined = compiled(inline="always")

SLOPES, DISPLACEMENTS, MEASURES, LOST = 0, 1, 2, -1
"""Columns of `counts`: saturated slopes and displacements, and the first of those of `loops/measures.py`;
behind them all, lost dots."""


@_inlined
def find_slopes(board, member, bell, k, before):
    """Phase PIXELS: from a frame to its slopes, and to what else follows from its pixels alone.

    k : the frame's number; the others are in `before`, in this order:
    frames : (frames, H, W, C) uint8; flat : (frames, H · W · C), the same; seen : `FrameNetwork.seen` of them
    background : (H · W · C) uint8; network : `FrameNetwork.tables`; dots : `FollowedDots.tables`
    settings : 2**−f of the slopes' fraction f; their largest word; rows of a task; whether slopes, measures
        and dots are wanted; whether no other phase follows
    bridged : thresholds of darkness, and how far a bridge reaches, or 0
    slopes : (2, H · W); weight : (axes, 2, H · W) of the force of slopes; without one, no elements
    found : `counts` and `shares`, and the places of normals, their words, and slopes
    """
    frames, flat, seen, background, network, dots, settings, bridged, slopes, weight, found = before
    unit, limit, each, wants_slopes, wants_measures, wants_dots, is_last = settings
    threshold, reach = bridged
    counts, shares, normals, normal_words, slopes_found = found
    begin(board, member, bell)
    _, height, width, channels = frames.shape
    normal = np.empty((3, each * width), np.float64)
    rest, hidden, _, tops, _, last = network
    memory = block_memory(rest, hidden, tops, last, normal)
    dark, over = np.empty((each, width), np.bool_), np.empty((2, each * width if reach else 0), np.bool_)
    others = 1 if wants_dots else 0
    task = take(board, PIXELS, member)
    while task < tasks(board, PIXELS):
        if task < others:
            follow(frames[k], *dots)
        else:
            first = (task - others) * each
            rows = min(each, height - first)
            start, stop = first * width, (first + rows) * width
            if wants_measures:
                measure(flat[k], background, width, channels, first, rows, counts[task, MEASURES:])
            if wants_slopes or normals.size or normal_words.size:
                forward(seen[k], *network, memory, start, stop, normal)
                if normal_words.size:
                    interleave_normals(normal, normal_words[k, 3 * start : 3 * stop])
                if normals.size:
                    unit_normals(normal, 1.0, normals[k, 3 * start : 3 * stop])
            if wants_slopes:
                p, q = slopes[0, start:stop], slopes[1, start:stop]
                saturated = slope_words(normal[0], normal[2], unit, limit, p, over[0])
                saturated += slope_words(normal[1], normal[2], unit, limit, q, over[1])
                if reach:
                    dark_pixels(frames[k], threshold, first, dark[:rows])
                    saturated = bridge(dark[:rows], reach, p, q, over)
                counts[task, SLOPES] = saturated
                if slopes_found.size:
                    interleave_slopes(p, q, unit, slopes_found[k, 2 * start : 2 * stop])
                for axis in range(len(weight)):
                    shares[task, axis] = weigh(p, weight[axis, 0, start:]) + weigh(q, weight[axis, 1, start:])
        done(board, PIXELS)
        task = take(board, PIXELS, member)
    if is_last:
        linger(board, member, bell)


@_inlined
def find_depth(board, member, bell, k, size, modes, sine, half_unit, behind):
    """Phase SOLUTION: from the solution's modes to its rows, depth, displacement, and what follows from
    these.

    k : the frame's number; size : N
    sine : `FoldedSine.rows_back`; half_unit : what is added before the floor of its result
    the others are in `behind`, in this order:
    tables : `Depth.rest` and the depth of the undeformed skin in mm, flat
    settings : whether depth is absolute; mm of its unit; whether displacements are wanted as words; of these
        whether negative ones count as zero, 2**−shift, and the largest
    bends : of the force's terms; weight : (axes, terms, N · N); without a force, no elements
    z : (N · N), becomes the displacement, in words where these are wanted
    found : `counts` and `shares`, and the places of depth words, depth in mm, displacement in mm and its
        words
    """
    tables, settings, bends, weight, z, found = behind
    absolute, unit, wants_words, clamp, word_unit, top = settings
    rest, rest_mm = tables
    counts, shares, depth_words, depth_mm, displacement_mm, words = found
    half, partial = sine.shape[1] * sine.shape[3], aligned_zeros(BAND, modes.shape[1], modes)
    wait(board, COLUMNS)
    band = take(board, SOLUTION, member)
    while band < tasks(board, SOLUTION):
        first = band * BAND
        start, stop = first * size, min(first + BAND, size) * size
        part, known = z[start:stop], rest[start:stop]
        rows_product(modes[first : first + BAND], sine, partial)
        unfold_rows(partial, half, half_unit, size, part)
        if depth_mm.size:
            framed_depth(part, size + 2, first, known, absolute, unit, rest_mm, depth_mm[k])
        in_words, in_mm = depth_words[k, start:stop], displacement_mm[k, start:stop]
        depth_and_displacement(part, known, absolute, unit, in_words, in_mm)
        if wants_words:
            saturated = displacement_words(part, clamp, word_unit, top, words[k, start:stop])
            counts[band, DISPLACEMENTS] = saturated
            if len(weight):
                weigh_terms(part, bends, weight, start, shares[band])
        done(board, SOLUTION)
        band = take(board, SOLUTION, member)
    linger(board, member, bell)


@_compiled
def slopes_alone(board, member, bell, k, before):
    """`find_slopes`, where no other phase follows."""
    find_slopes(board, member, bell, k, before)


@_compiled
def conclude(board, phase, k, counts, shares, dots, limits, force, found):
    """Wait for a frame's last phase, and add up what its tasks have counted.

    dots : which are seen, their shifts, and their weights (axes, M, 2) with exponents (axes,), of DotForce
    limits : for each of FrameValidity's measures its column of `counts`, or −1 for lost dots; its limits, low
        and high; and its flag
    force : constants and units of the force, (axes,) each
    found : places of raw force, force in N, measures, flags, and of how many slopes and displacements
        saturated
    """
    seen, shifts, dot_weight, exponent = dots
    columns, low, high, bits = limits
    constant, unit_n = force
    raw, force_n, measures, validity, steep, far = found
    wait(board, phase)
    totals = np.zeros(counts.shape[1] + 1, np.int64)
    for task in range(len(counts)):
        for column in range(counts.shape[1]):
            totals[column] += counts[task, column]
    for dot in range(len(seen)):
        totals[LOST] += not seen[dot]
    flags = 0
    for j in range(len(columns)):
        value = totals[columns[j]]
        flags |= bits[j] if value < low[j] or value > high[j] else 0
        if measures.size:
            measures[k, j] = value
    if validity.size:
        validity[k, 0] = flags
    if steep.size:
        steep[k, 0] = totals[SLOPES]
    if far.size:
        far[k, 0] = totals[DISPLACEMENTS]
    for axis in range(len(constant)):
        total, of_dots = constant[axis], 0
        for task in range(len(shares)):
            total += shares[task, axis]
        for dot in range(dot_weight.shape[1]):
            of_dots += dot_weight[axis, dot, 0] * shifts[dot, 0] + dot_weight[axis, dot, 1] * shifts[dot, 1]
        total += of_dots * 2.0 ** exponent[axis]
        if raw.size:
            raw[k, axis] = np.int64(total)
        if force_n.size:
            force_n[k, axis] = total * unit_n[axis]
