"""Integers in floating point: below which bounds they are exact, and how they are rounded.

The emulator's tables carry each stage's shift, so that any rounding is a floor. A power of two only moves the
exponent: what is an integer below 2**53 times 2**−shift is exact in float64, and so is every partial sum, in
whatever order BLAS adds.
"""

import numpy as np

from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.words import NEAREST
from fastac.models.loops.sines import FoldedSine, is_foldable

EXACT = 1 << 53
EXACT_FLOAT32 = 1 << 24
"""Below these bounds every integer is exact, in float64 and in float32."""


class NotExactError(ValueError):
    """Tables whose integers float64 might not hold, or that are not as the emulator wants them."""


def require_exact(name: str, bound: int) -> None:
    """Raise NotExactError where integers of up to `bound` are not all exact in float64."""
    if bound >= EXACT:
        raise NotExactError(f"{name} bound {bound}: integers of 2**53 and more are not exact in float64")


def added(rounding: str) -> float:
    """`words.half_unit` once the shift is in the table; a floor's 0 makes +0 of −0, as with integers."""
    return 0.5 if rounding == NEAREST else 0.0


def round_in_place(x: np.ndarray, half: float = 0.5) -> np.ndarray:
    """`floor(x + half)`: what `words.round_shift` does once the shift is in the table; see `added`."""
    np.add(x, half, out=x)
    return np.floor(x, out=x)


def folded_transform(name: str, transform: SineTransform) -> FoldedSine:
    """A transform's table for float64; raises NotExactError, with the stage's name, where it cannot be."""
    require_exact(name, transform.accumulator_bound)
    if not is_foldable(transform.matrix):
        raise NotExactError(f"{name} matrix: expected rows even and odd about the middle in turn")
    return FoldedSine(transform.matrix * 2.0**-transform.shift)


def largest_word(width: int) -> int:
    """The largest magnitude of a signed word of `width` bits."""
    return 1 << (width - 1)
