"""Fixed-point words: widths from bounds, rounding, and exact integer products through BLAS."""

from dataclasses import dataclass

import numpy as np


def _fits(name: str, values, bits: int, *, signed: bool) -> None:
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    values = np.asarray(values)
    if values.size and (values.min() < low or values.max() > high):
        raise ValueError(f"{name} {values.min()} to {values.max()}: expected {low} to {high}")


@dataclass(frozen=True)
class Fixed:
    """A signed two's complement word of `width` bits, the last `fraction` of them behind the point."""

    width: int
    fraction: int

    def __post_init__(self):
        if not 2 <= self.width <= 62:
            raise ValueError(f"width {self.width}: expected 2 to 62")

    @property
    def limit(self) -> int:
        """The largest magnitude that both signs can hold, 2**(width-1) − 1."""
        return (1 << (self.width - 1)) - 1

    def to_float(self, words: np.ndarray) -> np.ndarray:
        return np.asarray(words, dtype=np.float64) * 2.0**-self.fraction


def signed_width(bound: int) -> int:
    """Bits of a signed word that holds every integer in −bound … +bound."""
    return int(bound).bit_length() + 1


def fit(bound: float, *, width: int, fraction: int) -> Fixed:
    """The word of at most `width` bits and `fraction` fractional bits that holds ±`bound` (in real units).

    The fraction gives way to the bound, never the other way round, so the word cannot overflow; bits that
    neither needs are not built.
    Raises ValueError if `width` bits cannot hold the bound's integer part.
    """
    for bits in range(fraction, -1, -1):
        needed = signed_width(int(np.ceil(bound * 2.0**bits)) + 1)
        if needed <= width:
            return Fixed(needed, bits)
    raise ValueError(f"{width} data bits cannot hold the bound {bound:.6g}")


NEAREST, FLOOR = "nearest", "floor"
LARGEST_ERROR = {NEAREST: 0.5, FLOOR: 1.0}
"""What a rounding changes a value by at most, in units of the last place that it keeps. A floor's changes are
all of one sign, half a unit downwards on average."""


def check_rounding(rounding: str) -> None:
    """Raise ValueError unless `rounding` is one of those that there are."""
    if rounding not in LARGEST_ERROR:
        raise ValueError(f"rounding {rounding!r}: expected {' or '.join(LARGEST_ERROR)}")


def half_unit(shift, rounding: str):
    """What is added before `shift` bits are dropped: half of 2**shift; with a floor nothing, and no gate."""
    half = (np.int64(1) << shift) >> 1
    return half if rounding == NEAREST else 0 * half


def round_shift(a: np.ndarray, shift, rounding: str = NEAREST) -> np.ndarray:
    """`a / 2**shift` to the nearest integer, halves upwards, or by "floor" to the next one below.

    shift : >= 0, a scalar or an array
    """
    return (a + half_unit(shift, rounding)) >> shift


def exact_matmul(a: np.ndarray, b: np.ndarray, bound: int) -> np.ndarray:
    """`a @ b` of int64 matrices, exactly, at BLAS speed.

    `bound` >= sum |a||b| of every element. Integers below 2**24 are exact in float32 and below 2**53 in
    float64, and so are all partial sums, in whatever order they are added.
    """
    if bound < 1 << 24:
        real = np.float32
    elif bound < 1 << 53:
        real = np.float64
    else:
        raise ValueError(f"bound {bound}: sums of 2**53 and more are not exact in float64")
    # Some BLAS kernels set the flag of an invalid operation without one. A result that is no number is
    # still found: the cast to integers would raise or warn.
    with np.errstate(invalid="ignore"):
        product = a.astype(real) @ b.astype(real)
    return product.astype(np.int64)


def to_words(values: np.ndarray, word: Fixed) -> np.ndarray:
    """Real values to the nearest words of a format; raises ValueError where one does not fit."""
    words = np.rint(np.asarray(values) * 2.0**word.fraction).astype(np.int64)
    if words.size and np.abs(words).max() > word.limit:
        raise ValueError(f"value {np.abs(values).max():.6g}: does not fit {word}")
    return words
