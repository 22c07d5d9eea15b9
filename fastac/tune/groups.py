"""What is held out in one piece when models are compared: recordings, objects or presses, never single frames
of one press."""

import numpy as np

from fastac.flow.few_presses import presses
from fastac.sensor.dataset import Dataset

FEWEST = 3
"""Folds, and units to make them of: with two folds left out together there must be one to learn from."""
TOUCHED = 0.05
"""Where only forces tell presses apart: the share of the largest force above which something touches."""


class TuneError(ValueError):
    """Data or settings that models cannot be chosen with; the message is one line."""


def units_of(data: Dataset, by: str | None = None) -> np.ndarray:
    """The unit that each frame belongs to, (frames,) text; "" for frames at rest of no unit.

    by : "group", the dataset's own groups; "press", see `_presses`; None: groups where there are FEWEST of
        them, else presses
    Raises TuneError where the dataset has no groups and they are asked for.
    """
    if by == "group" and data.group is None:
        raise TuneError("group: missing, so groups cannot be held out")
    if data.group is not None and by != "press":
        found = np.where(data.at_rest, "", data.group)
        if by == "group" or len(names_of(found)) >= FEWEST:
            return found
    return _presses(data)


def names_of(units: np.ndarray) -> list[str]:
    """The units' names in the order in which they appear."""
    return [name for name in dict.fromkeys(units.tolist()) if name]


def _presses(data: Dataset) -> np.ndarray:
    """The press of each frame: by its place where that is known, else by the force between which nothing
    touches, else each frame in contact by itself."""
    found = presses(data)
    if len(names_of(found)) > 1:
        return found
    number = np.arange(len(data))
    if data.force_n is not None:
        load = np.abs(data.force_n).max(axis=1)
        touched = load > TOUCHED * load.max()
        number = np.maximum(np.cumsum(touched & ~np.roll(touched, 1)), 1)
    return np.where(data.at_rest, "", [f"press {k}" for k in number])


def folds_of(units: np.ndarray, count: int, seed: int) -> list[list[str]]:
    """The units' names in `count` folds of about equally many frames, by chance.

    Raises TuneError where there are too few units.
    """
    names = names_of(units)
    if count < FEWEST:
        raise TuneError(f"folds = {count}: expected {FEWEST} or more")
    if len(names) < count:
        raise TuneError(f"{len(names)} groups or presses for {count} folds: expected one for each at least")
    order = [names[k] for k in np.random.default_rng(seed).permutation(len(names))]
    frames = {name: int((units == name).sum()) for name in names}
    folds: list[list[str]] = [[] for _ in range(count)]
    for name in sorted(order, key=lambda name: -frames[name]):
        smallest = min(folds, key=lambda fold: (sum(frames[other] for other in fold), len(fold)))
        smallest.append(name)
    return folds
