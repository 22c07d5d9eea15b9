"""The Poisson solver of two sine transforms and a division in integers, and each word's width."""

from dataclasses import dataclass

import numpy as np

from fastac.models.integer.bounds import (
    GUARD_BITS,
    Stage,
    between_rows,
    coefficients,
    green_norm,
    stencil_norms,
)
from fastac.models.integer.laplacian import STENCILS, eigenvalues, row_eigenvalues
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.words import (
    LARGEST_ERROR,
    NEAREST,
    Fixed,
    _fits,
    check_rounding,
    fit,
    half_unit,
    round_shift,
)


@dataclass(frozen=True, eq=False)
class EigenvalueDivision:
    """`round_shift(−x · mantissa, shift, rounding)`, element by element.

    The eigenvalues 2cos(πm/(N+1)) + 2cos(πn/(N+1)) − 4 are negative; mantissa · 2**−shift is the reciprocal
    of their magnitude times the change of units, the mantissa normalised to 17 bits.
    """

    mantissa: np.ndarray  # (N, N) unsigned, 2**16 … 2**17 − 1
    shift: np.ndarray  # (N, N)
    input_width: int
    output_width: int
    rounding: str = NEAREST

    def __post_init__(self):
        check_rounding(self.rounding)
        _fits("mantissa", self.mantissa, 17, signed=False)
        _fits("shift", self.shift - 1, 6, signed=False)
        for table in (self.mantissa, self.shift):
            if not np.array_equal(table, table.T):
                raise ValueError("table: expected symmetric")

    @property
    def size(self) -> int:
        return len(self.mantissa)

    @property
    def half_bit(self) -> int:
        """What rounding adds once all bits of a shift but one are dropped; 0 with a floor."""
        return int(half_unit(1, self.rounding))

    @property
    def product_width(self) -> int:
        return self.input_width + 17

    def __call__(self, coefficients: np.ndarray) -> np.ndarray:
        """Coefficients (..., N, N), of either orientation, to the solution's coefficients."""
        return round_shift(-coefficients * self.mantissa, self.shift, self.rounding)


MANTISSA_BITS = 17


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
class Solver(IntegerSolver):
    """The integer solver's four transforms and the division, with each word's worst case."""

    row_forward: SineTransform
    column_forward: SineTransform
    division: EigenvalueDivision
    column_inverse: SineTransform
    row_inverse: SineTransform
    stages: tuple[Stage, ...]
    transposed_before = frozenset({"column_forward", "row_inverse"})

    @classmethod
    def fitted(
        cls,
        *,
        offset: np.ndarray,
        source: Fixed,
        slope_limit: float,
        divergence: str,
        coefficient_fraction: int,
        data_bits: int,
        rounding: str = NEAREST,
    ) -> "Solver":
        check_rounding(rounding)
        n = len(offset)
        fraction = source.fraction + GUARD_BITS
        matrix = coefficients(n, coefficient_fraction)
        s = matrix * 2.0**-coefficient_fraction
        mantissa, exponent = reciprocals(n)
        reciprocal = mantissa * 2.0**-exponent
        along, across = stencil_norms(s, divergence)
        norm = STENCILS[divergence].norm
        constant = source.to_float(offset)
        stages = []

        def choose(name: str, bound: np.ndarray) -> float:
            """Fix the word of a stage; returns the rounding error it adds, in px."""
            word = fit(float(bound.max()), width=data_bits, fraction=fraction)
            stages.append(Stage(name, float(bound.max()), word))
            return LARGEST_ERROR[rounding] * 2.0**-word.fraction

        # Rows: (i, n).
        bound = slope_limit * (along + norm * across)[None, :] + np.abs(constant @ s)
        e1 = choose("row_forward", bound)
        # Columns: (m, n).
        bound = slope_limit * (np.outer(across, along) + np.outer(along, across)) + np.abs(s @ constant @ s)
        bound += e1 * across[:, None]
        e2 = choose("column_forward", bound)
        e3 = choose("division", (bound + e2) * reciprocal)
        # Inverse columns, (i, n): one N×N operator per mode n, over source rows.
        solution = s @ constant @ s * reciprocal
        along_rows, across_rows = stencil_norms(between_rows(s, reciprocal), divergence)
        bound = slope_limit * (across_rows * along[:, None] + along_rows * across[:, None]).T + np.abs(
            s @ solution
        )
        bound += e1 * across_rows.T + e2 * (np.abs(s) @ reciprocal) + e3 * across[:, None]
        e4 = choose("column_inverse", bound)
        # Inverse rows, (i, j).
        errors = (e1 * across_rows.T + e2 * (np.abs(s) @ reciprocal) + (e3 * across[:, None] + e4)) @ np.abs(
            s
        )
        bound = slope_limit * green_norm(s, reciprocal, divergence) + np.abs(s @ solution @ s) + errors
        choose("row_inverse", bound)

        words = [source] + [stage.format for stage in stages]

        def transform(into: Fixed, out: Fixed) -> SineTransform:
            shift = coefficient_fraction + into.fraction - out.fraction
            return SineTransform(matrix, shift, into.width, out.width, rounding)

        return cls(
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

    def mode_operators(self) -> dict[str, np.ndarray]:
        s = self.row_forward.matrix.astype(np.float64)
        forward = np.broadcast_to(s, (len(s), *s.shape))
        reciprocal = self.division.mantissa * 2.0**-self.division.shift
        divided = reciprocal.T[:, :, None] * forward
        back = between_rows(s, reciprocal)
        return {"column_forward": forward, "division": divided, "column_inverse": back}
