"""Worst-case bounds of the integer Poisson solver, and the word formats that follow from them.

Every value in the solver is a linear function of the slopes plus a constant (the prior or the background)
plus rounding errors. Its largest magnitude is therefore the L1 norm of that linear function times the slope
limit, plus the constant, plus the L1 norm of the rounding errors' way to it. The linear functions are built
from the integer tables themselves, so the bounds hold for the hardware, not for an ideal transform.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fastac.models.fixed import LARGEST_ERROR, NEAREST, Fixed, check_rounding, fit
from fastac.models.integer import EigenvalueDivision, SineTransform
from fastac.models.poisson import eigenvalues, row_eigenvalues, sine_matrix

MANTISSA_BITS = 17
GUARD_BITS = 4
"""Fractional bits of the data beyond the slopes', where the bound leaves room for them."""


@dataclass(frozen=True)
class Stage:
    """A word of the solver: its worst case in px and the format that holds it."""

    name: str
    bound_px: float
    format: Fixed


def stencil_norms(matrix: np.ndarray, divergence: str) -> tuple[np.ndarray, np.ndarray]:
    """L1 norms over a row or column of slopes: (along the derivative, across it), each (N,)."""
    kernel = {"central": np.array([0.5, 0.0, -0.5]), "backward": np.array([1.0, -1.0])}[divergence]
    along = np.abs(np.array([np.convolve(row, kernel) for row in matrix])).sum(axis=1)
    return along, np.abs(matrix).sum(axis=1)


def green_norm(matrix: np.ndarray, reciprocal: np.ndarray, divergence: str) -> float:
    """max over pixels of the L1 norm of the map from slopes to that pixel's solution.

    The square's symmetries leave one octant of pixels to try: mirrored, a stencil only changes its sign.
    Kept for the next solver of the same tables, as a sweep has many.
    """
    tables = (np.asarray(table, np.float64).tobytes() for table in (matrix, reciprocal))
    return _green_norm(len(matrix), *tables, divergence)


@lru_cache(maxsize=16)
def _green_norm(size: int, of_matrix: bytes, of_reciprocal: bytes, divergence: str) -> float:
    matrix, reciprocal = (np.frombuffer(table).reshape(size, size) for table in (of_matrix, of_reciprocal))
    half = (size + 1) // 2
    worst = 0.0
    for i in range(half):
        rows = matrix @ (matrix[i][:, None] * reciprocal)
        green = (rows * matrix[i:half, None, :]) @ matrix
        padded = np.pad(green, ((0, 0), (2, 2), (2, 2)))
        if divergence == "central":
            norms = [
                0.5 * np.abs(padded[:, 2:] - padded[:, :-2]),
                0.5 * np.abs(padded[:, :, 2:] - padded[:, :, :-2]),
            ]
        else:
            norms = [np.abs(np.diff(padded, axis=1)), np.abs(np.diff(padded, axis=2))]
        worst = max(worst, float(sum(x.sum(axis=(1, 2)) for x in norms).max()))
    return worst


def coefficients(size: int, fraction: int) -> np.ndarray:
    """The DST-I's integers, round(2**fraction · sine_matrix)."""
    return np.rint(sine_matrix(size) * 2.0**fraction).astype(np.int64)


def reciprocals(size: int) -> tuple[np.ndarray, np.ndarray]:
    """1/|eigenvalue| of every mode as `normalised`."""
    return normalised(1 / np.abs(eigenvalues(size)))


def reciprocal_distance(size: int) -> int:
    """Of the largest from the smallest exponent in `reciprocals`: those of the last and the first mode."""
    one = row_eigenvalues(size)[[0, -1]]
    _, exponent = normalised(1 / np.abs(one + one))
    return int(exponent[1] - exponent[0])


def normalised(magnitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`magnitude` > 0 as (mantissa, exponent): mantissa · 2**−exponent, mantissa of 17 bits."""
    exponent = MANTISSA_BITS - 1 - np.floor(np.log2(magnitude)).astype(np.int64)
    mantissa = np.rint(magnitude * 2.0**exponent).astype(np.int64)
    overflow = mantissa == 1 << MANTISSA_BITS
    return np.where(overflow, mantissa >> 1, mantissa), np.where(overflow, exponent - 1, exponent)


@dataclass(frozen=True, eq=False)
class Solver:
    """The integer solver's four transforms and the division, with each word's worst case."""

    row_forward: SineTransform
    column_forward: SineTransform
    division: EigenvalueDivision
    column_inverse: SineTransform
    row_inverse: SineTransform
    stages: tuple[Stage, ...]

    @property
    def depth_format(self) -> Fixed:
        return self.stages[-1].format

    def __call__(self, source: np.ndarray) -> np.ndarray:
        """Sources (..., N, N), integers, to solutions (..., N, N) in words of `depth_format`."""
        rows = self.row_forward(source)
        spectrum = self.column_forward(np.swapaxes(rows, -1, -2))  # (…, column mode n, row mode m)
        solution = self.column_inverse(self.division(spectrum))
        return self.row_inverse(np.swapaxes(solution, -1, -2))


def solver(
    *,
    offset: np.ndarray,
    source: Fixed,
    slope_limit: float,
    divergence: str,
    coefficient_fraction: int,
    data_bits: int,
    rounding: str = NEAREST,
) -> Solver:
    """Choose every word of the solver from its worst case.

    offset : (N, N) integers in the source's unit, as in PoissonSource
    source : format of the right-hand side; slope_limit : the largest |slope| that the slopes' word holds
    rounding : of every stage; a floor's errors are up to a whole unit, and the words hold them

    Raises ValueError where `data_bits` cannot hold a bound.
    """
    check_rounding(rounding)
    n = len(offset)
    fraction = source.fraction + GUARD_BITS
    matrix = coefficients(n, coefficient_fraction)
    s = matrix * 2.0**-coefficient_fraction
    mantissa, exponent = reciprocals(n)
    reciprocal = mantissa * 2.0**-exponent
    along, across = stencil_norms(s, divergence)
    twice = 1.0 if divergence == "central" else 2.0  # Σ|stencil| across the transform's direction
    constant = source.to_float(offset)
    stages = []

    def choose(name: str, bound: np.ndarray) -> float:
        """Fix the word of a stage; returns the rounding error it adds, in px."""
        word = fit(float(bound.max()), width=data_bits, fraction=fraction)
        stages.append(Stage(name, float(bound.max()), word))
        return LARGEST_ERROR[rounding] * 2.0**-word.fraction

    # Rows: (i, n).
    bound = slope_limit * (along + twice * across)[None, :] + np.abs(constant @ s)
    e1 = choose("row_forward", bound)
    # Columns: (m, n).
    bound = slope_limit * (np.outer(across, along) + np.outer(along, across)) + np.abs(s @ constant @ s)
    bound += e1 * across[:, None]
    e2 = choose("column_forward", bound)
    e3 = choose("division", (bound + e2) * reciprocal)
    # Inverse columns, (i, n): one N×N operator per mode n, over source rows.
    solution = s @ constant @ s * reciprocal
    operators = np.einsum("im,mn,mk->nik", s, reciprocal, s, optimize=True)
    across_rows = np.abs(operators).sum(axis=2)
    along_rows = np.stack([stencil_norms(o, divergence)[0] for o in operators])
    bound = slope_limit * (across_rows * along[:, None] + along_rows * across[:, None]).T + np.abs(
        s @ solution
    )
    bound += e1 * across_rows.T + e2 * (np.abs(s) @ reciprocal) + e3 * across[:, None]
    e4 = choose("column_inverse", bound)
    # Inverse rows, (i, j).
    errors = (e1 * across_rows.T + e2 * (np.abs(s) @ reciprocal) + (e3 * across[:, None] + e4)) @ np.abs(s)
    bound = slope_limit * green_norm(s, reciprocal, divergence) + np.abs(s @ solution @ s) + errors
    choose("row_inverse", bound)

    words = [source] + [stage.format for stage in stages]

    def transform(into: Fixed, out: Fixed) -> SineTransform:
        shift = coefficient_fraction + into.fraction - out.fraction
        return SineTransform(matrix, shift, into.width, out.width, rounding)

    return Solver(
        row_forward=transform(words[0], words[1]),
        column_forward=transform(words[1], words[2]),
        division=EigenvalueDivision(
            mantissa,
            exponent + words[2].fraction - words[3].fraction,
            words[2].width,
            words[3].width,
            rounding,
        ),
        column_inverse=transform(words[3], words[4]),
        row_inverse=transform(words[4], words[5]),
        stages=tuple(stages),
    )
