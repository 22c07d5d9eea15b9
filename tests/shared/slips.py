"""Dots that touch something and slip or do not, for tests of their spread."""

import dots
import numpy as np

from fastac.gateware.slip.rigid_sums import sums_layout
from fastac.models.integer.dot_spread import DotSpread


def sums(spread: DotSpread, shifts: np.ndarray, contact: np.ndarray) -> dict[str, int]:
    """The sums of one frame and A, B, C by their definition, in Python's integers; names as in `bounds`."""
    rows = np.hstack([spread.xy, shifts])[contact].tolist()
    n, (x, y, u, v) = len(rows), (sum(row[k] for row in rows) for k in range(4))
    square = sum(r[2] ** 2 + r[3] ** 2 for r in rows)
    turn = sum(r[0] * r[3] - r[1] * r[2] for r in rows)
    far = sum(r[0] ** 2 + r[1] ** 2 for r in rows)
    found = {"n": n, "u": u, "v": v, "x": x, "y": y, "square": square, "turn": turn, "far": far}
    found["A"] = n * square - u**2 - v**2
    found["B"] = n * turn - x * v + y * u
    return found | {"C": n * far - x**2 - y**2}


def extremes(spread: DotSpread) -> tuple[np.ndarray, np.ndarray]:
    """Shifts (frames, M, 2) and contacts (frames, M) at which each sum is as large as it can be, either sign.

    None, two and three dots alone; all or those on one side with the largest shifts: alike, in circles, and
    of alternating signs, which leave the largest spread.
    """
    count, limit, (x, y) = len(spread.place), spread.shift_limit, spread.xy.T
    every, index = np.ones(count, bool), np.arange(count)
    alike = np.full((count, 2), limit)
    turning = limit * np.stack([np.where(y > 0, -1, 1), np.where(x > 0, 1, -1)], axis=-1)
    turns = np.array([1 - 2 * (k.bit_count() % 2) for k in range(count)])  # no rigid motion fits them
    checkered = alike * turns[:, None]
    crossed = alike * np.stack([turns, -turns], axis=-1)
    sides = [x > 0, x < 0, y > 0, y < 0]
    cases = [(shifts, every) for shifts in (0 * alike, alike, turning, checkered, crossed)]
    cases += [(shifts, side) for side in sides for shifts in (alike, turning, checkered)]
    cases += [(turning, index < few) for few in range(min(count, 4) + 1)]
    shifts, contact = (np.array(values) for values in zip(*cases, strict=True))
    return np.concatenate([shifts, -shifts]), np.concatenate([contact, contact])


def frames(spread: DotSpread, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The extremes, and `count` frames at random in which few dots touch, or many; of every third all move
    rigidly; of another third three or four touch, of which every unit of the sums counts; of the last third
    all dots of one side touch, whose places have the largest sums."""
    rng, (shifts, contact) = np.random.default_rng(1), extremes(spread)
    shape = (count, len(spread.place))
    limit = spread.shift_limit >> rng.integers(0, spread.shift_limit.bit_length(), (count, 1, 1))
    moved, touch = rng.integers(-limit, limit + 1, (*shape, 2)), rng.random(shape) < rng.random((count, 1))
    x, y = spread.xy.T
    turns = np.stack([-y, x], axis=-1) * rng.choice([-3, -2, -1, 1, 2, 3], (count, 1, 1))
    rigid = turns + rng.integers(-limit, limit + 1, (count, 1, 2))
    fits = np.abs(rigid).max(axis=(1, 2)) <= spread.shift_limit
    moved[::3] = np.where(fits[:, None, None], rigid, moved)[::3]
    few = rng.permuted(np.broadcast_to(np.arange(shape[1]), shape), axis=1) < rng.integers(3, 5, (count, 1))
    touch[1::3] = few[1::3]
    sides = np.stack([x > 0, x < 0, y > 0, y < 0])
    touch[2::3] = sides[rng.integers(0, len(sides), count)][2::3]
    return np.concatenate([shifts, moved]), np.concatenate([contact, touch])


def sum_payloads(spread: DotSpread, shifts: np.ndarray, contact: np.ndarray) -> list[int]:
    """The sums of frames as payloads of the hardware."""
    layout = sums_layout(spread)
    found = (sums(spread, *frame) for frame in zip(shifts, contact, strict=True))
    return [dots.packed(layout, [values[name] for name in layout.members]) for values in found]


def contact_payloads(contact: np.ndarray, order: np.ndarray) -> list[int]:
    """Contacts (frames, M) as payloads in which bit k belongs to dot `order[k]`."""
    return [sum(int(bit) << k for k, bit in enumerate(bits)) for bits in contact[:, order]]


def displacement_payloads(
    displacement: np.ndarray, bits: int, lanes: int, *, rows_reversed: bool
) -> list[int]:
    """Displacements (frames, N, N) as beats; the void lanes at the end of each row have noise."""
    count, rows, columns = displacement.shape
    wide = -(-columns // lanes) * lanes
    found = np.random.default_rng(9).integers(0, 1 << bits, (count, rows, wide))
    found[..., :columns] = displacement & ((1 << bits) - 1)
    beats = found[:, :: -1 if rows_reversed else 1].reshape(-1, lanes).tolist()
    return [sum(word << k * bits for k, word in enumerate(beat)) for beat in beats]
