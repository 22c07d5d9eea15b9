"""Incipient slip in integers: the spread of the touching dots about the rigid motion that fits them.

A dot whose skin sticks to an object moves as the object does, and objects are rigid. Where the contact's
edge slides already, dots stay behind. So what is left of the shifts of the dots in contact when the rigid
motion, a translation and a rotation in the image, that fits them best is taken away tells how near slip is.

With n dots in contact at x, y, and sums over them of their shifts u, v,

    A = n Σ(u² + v²) − (Σu)² − (Σv)²
    B = n Σ(x v − y u) − Σx Σv + Σy Σu
    C = n Σ(x² + y²) − (Σx)² − (Σy)²

the best translation leaves A / n, and the best small rotation takes B² / (n C) of it away (linear least
squares). The spread is the mean square of what is left, (A C − B²) / (n² C).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.dot_follower import FRACTION, DotFollower

LEAST_DOTS = 3
"""Two dots have four shifts and a rigid motion has three parameters: their spread would mean nothing."""


@dataclass(frozen=True, eq=False)
class DotSpread:
    """The spread of M dots' shifts in px² · 2**(2 · FRACTION), and how many dots are in contact.

    A dot is in contact if it is seen and the displacement at its place at rest is more than `threshold`.
    """

    place: np.ndarray
    """(M, 2): column and row of each dot at rest among the displacement's N × N values."""
    threshold: int
    shift_limit: int
    """The largest magnitude of a shift."""
    side: int | None = None
    """N where the hardware may be loaded with any other places; None: it has those alone."""

    def __post_init__(self):
        if self.threshold < 0:
            raise ValueError(f"threshold {self.threshold}: expected at least 0: skin at rest touches nothing")
        _, index, times = np.unique(self.place, axis=0, return_index=True, return_counts=True)
        if times.max() > 1:
            u, v = self.place[index[times.argmax()]] + 1
            raise ValueError(f"dot at {u}, {v} px: another is at the same pixel")

    @classmethod
    def of_follower(cls, follower: DotFollower, threshold: int) -> "DotSpread":
        """Of the dots that `follower` follows; those on the image's rim are looked up beside it."""
        height, width = follower.windows.image
        place = np.clip(follower.rest_px - 1, 0, np.array([width, height]) - 3)
        return cls(place, threshold, follower.bound, max(height, width) - 2 if follower.loadable else None)

    @cached_property
    def xy(self) -> np.ndarray:
        """Places from the middle of them all, (M, 2) in px: a rotation does not depend on its centre, and
        so the sums are small."""
        return self.place - (self.place.min(axis=0) + self.place.max(axis=0)) // 2

    @property
    def largest(self) -> tuple[int, int, int]:
        """The largest magnitudes of a dot's x, y and x² + y²."""
        if self.side:
            return self.side // 2, self.side // 2, 2 * (self.side // 2) ** 2
        return *np.abs(self.xy).max(axis=0).tolist(), int((self.xy**2).sum(axis=1).max())

    @property
    def bounds(self) -> dict[str, int]:
        """The largest magnitude of each sum, and of A, B, C and the spread, whichever dots are in contact."""
        count, limit = len(self.place), self.shift_limit
        if self.side:
            x, y, far = (count * value for value in self.largest)
            away, arms = x + y, count * (x + y)
        else:
            x, y = np.maximum(self.xy.clip(0).sum(axis=0), -self.xy.clip(max=0).sum(axis=0)).tolist()
            away, far = int(np.abs(self.xy).sum()), int((self.xy**2).sum())
            arms = int(np.abs(count * self.xy - self.xy.sum(axis=0)).sum())
        found = {
            "n": count,
            "u": count * limit,
            "v": count * limit,
            "x": x,
            "y": y,
            "square": 2 * count * limit**2,
            "turn": away * limit,
            "far": far,
        }
        found["A"] = count * found["square"]
        # B sums shifts by n x − Σx and n y − Σy, whose magnitudes' sum grows with each further dot.
        found["B"] = arms * limit
        found["C"] = count * found["far"]
        return found | {"spread": 2 * limit**2}

    def contact(self, displacement: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Displacements (..., N, N) and which dots are seen, (..., M), to which are in contact, (..., M)."""
        column, row = self.place.T
        return (displacement[..., row, column] > self.threshold) & seen

    def sums(self, shifts: np.ndarray, contact: np.ndarray) -> dict[str, np.ndarray]:
        """Sums over the dots in contact (..., M) of their shifts (..., M, 2), and A, B, C: (...) each, by the
        names of `bounds`. In Python's integers, for the products have more than 64 bits."""
        u, v = np.moveaxis(np.where(contact[..., None], shifts, 0).astype(object), -1, 0)
        x, y = np.moveaxis(np.where(contact[..., None], self.xy, 0).astype(object), -1, 0)
        terms = {
            "n": contact.astype(object),
            "u": u,
            "v": v,
            "x": x,
            "y": y,
            "square": u * u + v * v,
            "turn": x * v - y * u,
            "far": x * x + y * y,
        }
        s = {name: values.sum(axis=-1) for name, values in terms.items()}
        return s | {
            "A": s["n"] * s["square"] - s["u"] * s["u"] - s["v"] * s["v"],
            "B": s["n"] * s["turn"] - s["x"] * s["v"] + s["y"] * s["u"],
            "C": s["n"] * s["far"] - s["x"] * s["x"] - s["y"] * s["y"],
        }

    @staticmethod
    def ratio(sums: dict[str, np.ndarray]) -> np.ndarray:
        """The spread (...) from the sums, rounded down; 0 of fewer than LEAST_DOTS."""
        n, a, b, c = (np.asarray(sums[name], object) for name in ("n", "A", "B", "C"))
        enough = n >= LEAST_DOTS
        # The rest is 0 or more by Cauchy's inequality, and C is more than 0 for dots at different places.
        spread = (a * c - b * b) // np.where(enough, np.asarray(c * n * n, object), 1)
        return np.where(enough, spread, 0).astype(np.int64)

    def __call__(
        self, shifts: np.ndarray, seen: np.ndarray, displacement: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shifts (..., M, 2), whether each dot is seen (..., M) and displacements (..., N, N) to the spread
        (...) and the number of dots in contact (...). Fewer than LEAST_DOTS have no spread."""
        sums = self.sums(shifts, self.contact(displacement, seen))
        return self.ratio(sums), np.asarray(sums["n"], np.int64)[()]


def spread_px(words: np.ndarray) -> np.ndarray:
    """Spreads in words to root mean squares in px."""
    return np.sqrt(words) * 2.0**-FRACTION


def spread_words(px: float) -> int:
    """A root mean square in px to the nearest spread in words."""
    return round((px * 2.0**FRACTION) ** 2)
