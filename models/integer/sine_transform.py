"""One pass of the orthonormal DST-I in integers."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.words import (
    NEAREST,
    check_rounding,
    exact_matmul,
    half_unit,
    round_shift,
    signed_width,
)


@dataclass(frozen=True, eq=False)
class SineTransform:
    """One orthonormal DST-I pass along rows: `round_shift(matrix @ x, shift, rounding)`.

    matrix[k, n] = round(2**coefficient_fraction · sqrt(2/(N+1)) · sin(π(k+1)(n+1)/(N+1))).
    `bound` is the largest magnitude of the output that any input of the whole chain can reach.
    """

    matrix: np.ndarray  # (N, N)
    shift: int
    input_width: int
    output_width: int
    rounding: str = NEAREST

    def __post_init__(self):
        n = len(self.matrix)
        if self.matrix.shape != (n, n) or not np.array_equal(self.matrix, self.matrix.T):
            raise ValueError(f"matrix {self.matrix.shape}: expected square and symmetric")
        if self.shift < 1:
            raise ValueError(f"shift {self.shift}: expected at least 1")
        check_rounding(self.rounding)

    @property
    def size(self) -> int:
        return len(self.matrix)

    @property
    def half_unit(self) -> int:
        """What rounding adds to a sum before the shift; 0 with a floor."""
        return int(half_unit(self.shift, self.rounding))

    @property
    def coefficient_width(self) -> int:
        return signed_width(int(np.abs(self.matrix).max()))

    @cached_property
    def accumulator_bound(self) -> int:
        """max over rows of Σ|coefficient|·|x|max, plus the half unit that rounding adds."""
        return (int(np.abs(self.matrix).sum(axis=1).max()) << (self.input_width - 1)) + self.half_unit

    @property
    def accumulator_width(self) -> int:
        return signed_width(self.accumulator_bound)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Rows (..., N) to their transforms (..., N)."""
        sums = exact_matmul(rows, self.matrix, self.accumulator_bound)
        return round_shift(sums, self.shift, self.rounding)
