"""Compiled loops over pixels of one frame: slopes, divergence, depth and displacement, and their words.

Each reads and writes memory once where NumPy would for every operation. They are IEEE's operations in the
order that is written, so that integers in float64 stay exact. Images are flat, row after row, so that any
rows of them are; an output of no elements is not wanted.
"""

import math

import numpy as np

from fastac.store.compiled_loops import compiled

_compiled = compiled(error_model="numpy")


@_compiled
def unit_normals(normal, shortest, out):
    """Scale normals (3, pixels or more) to unit length, written to `out` (pixels · 3,); lengths are at least
    `shortest`."""
    n_x, n_y, n_z = normal[0], normal[1], normal[2]
    for p in range(len(out) // 3):
        x, y, z = n_x[p], n_y[p], n_z[p]
        length = math.sqrt(x * x + y * y + z * z)
        length = length if length > shortest else shortest
        out[3 * p] = x / length
        out[3 * p + 1] = y / length
        out[3 * p + 2] = z / length


@_compiled
def interleave_normals(normal, out):
    """Copy normals (3, pixels or more) to `out` (pixels · 3,), the components of a pixel side by side."""
    n_x, n_y, n_z = normal[0], normal[1], normal[2]
    for p in range(len(out) // 3):
        out[3 * p] = n_x[p]
        out[3 * p + 1] = n_y[p]
        out[3 * p + 2] = n_z[p]


@_compiled
def interleave_slopes(p_x, q_y, unit, out):
    """Write slopes p and q (pixels,) times `unit` to `out` (pixels · 2,), those of a pixel side by side."""
    for p in range(len(p_x)):
        out[2 * p] = p_x[p] * unit
        out[2 * p + 1] = q_y[p] * unit


@_compiled
def slope_words(component, n_z, unit, limit, out, over):
    """`integer.GradientRatio` of a component of normals and n_z to slopes `out` (pixels,) along its axis;
    returns how many saturated.

    unit : 2**−f, f the slopes' fraction; over : which saturated, if wanted

    The magnitude is floor(a / b), a = |n_xy| + n_z · 2**−(f+1), b = n_z · 2**−f.
    In units of 2**−(f+1) a and b are integers, a + b < 2**53. A quotient below an integer k then lies at
    least 1/b below it. Were it rounded up to k, which float64 holds, 1/b would be at most k · 2**−54, and
    b · k >= 2**54; but b · k <= a + b.
    """
    saturated = 0
    for p in range(len(out)):
        n = component[p]
        steep = not n_z[p] > 0
        divisor = unit if steep else n_z[p] * unit
        magnitude = np.floor((abs(n) + divisor * 0.5) / divisor)
        if steep:
            magnitude = 0.0 if n == 0 else limit
        beyond = (magnitude > limit) or steep
        saturated += beyond
        if len(over):
            over[p] = beyond
        magnitude = magnitude if magnitude < limit else limit
        out[p] = 0.0 - math.copysign(magnitude, n)  # no −0, as with integers
    return saturated


@_compiled
def limited_slopes(component, n_z, limit, out):
    """`normals.slopes_of` of a component of normals and n_z, to slopes `out` (pixels,) of their type."""
    for p in range(len(out)):
        n = component[p]
        slope = -n / n_z[p] if n_z[p] > 0 else -np.sign(n) * limit
        slope = slope if slope == slope else n_z.dtype.type(0)  # the quotient of infinities
        slope = slope if slope < limit else limit
        out[p] = slope if slope > -limit else -limit


@_compiled
def source(slopes, width, first, ahead, scale, offset, out):
    """Divergence of slopes (2, H · W) times `scale`, less `offset` ((H − 2) · (W − 2),): its rows from
    `first` on, as many as `out` holds.

    ahead : of the divergence's `laplacian.Stencil`
    """
    columns, p, q = width - 2, slopes[0], slopes[1]
    for i in range(len(out) // columns):
        row, known = out[i * columns :], offset[(first + i) * columns :]
        above = (first + i) * width + 1
        here, below = above + width - 1, above + (1 + ahead) * width
        left, right, upper, lower = p[here:], p[here + 1 + ahead :], q[above:], q[below:]
        for j in range(columns):
            row[j] = ((right[j] - left[j]) + (lower[j] - upper[j])) * scale - known[j]


@_compiled
def depth_and_displacement(z, rest, absolute, unit, words, displacement_mm):
    """`integer.Depth` of solutions z (pixels,), which become displacements.

    rest : the depth at rest; words : the depth in words, displacement_mm : in multiples of `unit` mm
    """
    for j in range(len(words)):
        words[j] = np.int64(z[j] if absolute else rest[j] + z[j])
    for j in range(len(z)):
        z[j] = (rest[j] if absolute else 0.0) - z[j]
    for j in range(len(displacement_mm)):
        displacement_mm[j] = z[j] * unit


@_compiled
def framed_depth(z, width, first, rest, absolute, unit, rest_mm, depth_mm):
    """Depth in multiples of `unit` mm of rows of solutions z from `first` on, into `depth_mm` (H · W,), and
    beside, above and below them the depth of the undeformed skin, `rest_mm`."""
    columns = width - 2
    rows = len(z) // columns
    for i in range(rows):
        row, known, start = z[i * columns :], rest[i * columns :], (first + i + 1) * width
        place = depth_mm[start + 1 :]
        for j in range(columns):
            place[j] = (row[j] if absolute else known[j] + row[j]) * unit
        for edge in (start, start + width - 1):
            depth_mm[edge] = rest_mm[edge]
    below = len(depth_mm) - width
    for u in range(width):
        if first == 0:
            depth_mm[u] = rest_mm[u]
        if (first + rows + 1) * width == below:
            depth_mm[below + u] = rest_mm[below + u]


@_compiled
def displacement_words(d, clamp, unit, top, words):
    """`integer.DisplacementQuantiser` of d (pixels,), in place and to `words`; returns how many saturated."""
    saturated = 0
    lowest = 0.0 if clamp else -np.inf
    for j in range(len(d)):
        value = d[j] if d[j] > lowest else lowest
        value = np.floor(value * unit + 0.5)
        saturated += abs(value) > top
        value = value if value < top else top
        d[j] = value if value > -top else -top
    for j in range(len(words)):
        words[j] = np.int64(d[j])
    return saturated
