"""Compiled per-pixel loops for one frame: slopes, divergence, depth and displacement, and their words.

Each reads and writes memory once where NumPy would for every operation. They are IEEE's operations in the
order that is written, so that integers in float64 stay exact. An output of no elements is not wanted.
"""

import math

import numpy as np
from numba import njit

_compiled = njit(nogil=True, cache=True, error_model="numpy")


@_compiled
def unit_normals(normal, shortest, out):
    """Scale normals (3, pixels) to unit length, written to `out` (pixels · 3,); lengths are at least
    `shortest`."""
    n_x, n_y, n_z = normal[0], normal[1], normal[2]
    for p in range(len(n_x)):
        x, y, z = n_x[p], n_y[p], n_z[p]
        length = math.sqrt(x * x + y * y + z * z)
        length = length if length > shortest else shortest
        out[3 * p] = x / length
        out[3 * p + 1] = y / length
        out[3 * p + 2] = z / length


@_compiled
def interleave_normals(normal, out):
    """Copy normals (3, pixels) to `out` (pixels · 3,), the components of a pixel side by side."""
    n_x, n_y, n_z = normal[0], normal[1], normal[2]
    for p in range(len(n_x)):
        out[3 * p] = n_x[p]
        out[3 * p + 1] = n_y[p]
        out[3 * p + 2] = n_z[p]


@_compiled
def interleave_slopes(slopes, unit, out):
    """Write slopes (2, pixels) times `unit` to `out` (pixels · 2,), p and q of a pixel side by side."""
    p_x, q_y = slopes[0], slopes[1]
    for p in range(len(p_x)):
        out[2 * p] = p_x[p] * unit
        out[2 * p + 1] = q_y[p] * unit


@_compiled
def slope_words(normal, unit, limit, out, over):
    """`integer.GradientRatio` of normals (3, pixels) to slopes (2, pixels); returns how many saturated.

    unit : 2**−f, f the slopes' fraction; over : (2, pixels) bool, which saturated, if wanted

    The magnitude is floor(a / b), a = |n_xy| + n_z · 2**−(f+1), b = n_z · 2**−f.
    In units of 2**−(f+1) a and b are integers, a + b < 2**53. A quotient below an integer k then lies at
    least 1/b below it. Were it rounded up to k, which float64 holds, 1/b would be at most k · 2**−54, and
    b · k >= 2**54; but b · k <= a + b.
    """
    saturated, n_z = 0, normal[2]
    for k in range(2):
        component, place = normal[k], out[k]
        for p in range(len(place)):
            n = component[p]
            steep = not n_z[p] > 0
            divisor = unit if steep else n_z[p] * unit
            magnitude = np.floor((abs(n) + divisor * 0.5) / divisor)
            if steep:
                magnitude = 0.0 if n == 0 else limit
            beyond = (magnitude > limit) or steep
            saturated += beyond
            if len(over):
                over[k, p] = beyond
            magnitude = magnitude if magnitude < limit else limit
            place[p] = 0.0 - math.copysign(magnitude, n)  # no −0, as with integers
    return saturated


@_compiled
def limited_slopes(normal, limit, out):
    """`normals.slopes_of` of normals (3, pixels), in planes (2, pixels) of their type."""
    n_z = normal[2]
    for k in range(2):
        component, place = normal[k], out[k]
        for p in range(len(place)):
            n = component[p]
            slope = -n / n_z[p] if n_z[p] > 0 else -np.sign(n) * limit
            slope = slope if slope == slope else n_z.dtype.type(0)  # the quotient of infinities
            slope = slope if slope < limit else limit
            slope = slope if slope > -limit else -limit
            place[p] = slope


@_compiled
def source(slopes, ahead, scale, offset, out):
    """Divergence of slopes (2, H, W) times `scale`, less `offset` (H − 2, W − 2), into `out`.

    ahead : of the divergence's `laplacian.Stencil`
    """
    rows, columns = out.shape
    for i in range(rows):
        left, right = slopes[0, i + 1], slopes[0, i + 1, 1 + ahead :]
        above, below = slopes[1, i, 1:], slopes[1, i + 1 + ahead, 1:]
        row, known = out[i], offset[i]
        for j in range(columns):
            row[j] = ((right[j] - left[j]) + (below[j] - above[j])) * scale - known[j]


@_compiled
def depth_and_displacement(z, rest, absolute, unit, words, depth_mm, displacement_mm):
    """`integer.Depth` of solutions z (N, N), which become displacements.

    words, depth_mm, displacement_mm : (N, N), the depth in words and both in multiples of `unit` mm
    """
    for i in range(len(z)):
        row, known = z[i], rest[i]
        if len(words):
            place = words[i]
            for j in range(len(row)):
                place[j] = np.int64(row[j] if absolute else known[j] + row[j])
        if len(depth_mm):
            mm = depth_mm[i]
            for j in range(len(row)):
                mm[j] = (row[j] if absolute else known[j] + row[j]) * unit
        for j in range(len(row)):
            row[j] = (known[j] if absolute else 0.0) - row[j]
        if len(displacement_mm):
            mm = displacement_mm[i]
            for j in range(len(row)):
                mm[j] = row[j] * unit


@_compiled
def displacement_words(d, clamp, unit, top, words):
    """`integer.DisplacementQuantiser` of d (N, N), in place and to `words`; returns how many saturated."""
    saturated = 0
    lowest = 0.0 if clamp else -np.inf
    for i in range(len(d)):
        row = d[i]
        for j in range(len(row)):
            value = row[j] if row[j] > lowest else lowest
            value = np.floor(value * unit + 0.5)
            saturated += abs(value) > top
            value = value if value < top else top
            row[j] = value if value > -top else -top
        if len(words):
            place = words[i]
            for j in range(len(row)):
                place[j] = np.int64(row[j])
    return saturated
