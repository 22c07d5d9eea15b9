"""Which frames belong together: those of one recording or press are no independent evidence."""

import numpy as np

from fastac.sensor.samples import Dataset

PLACES = (("grid_x_mm", "grid_y_mm"), ("x_mm", "y_mm"), ("center_px",))
"""Keys of `indenter` that say where a press is; the first that a dataset has count."""
STRETCHES = 5
"""Into so many stretches of neighbouring frames a recording is divided that is the only one."""


def places(data: Dataset) -> np.ndarray:
    """Where each frame's press is, (frames, 2), NaN without contact; (frames, 0) where no place is known."""
    known = data.indenter or {}
    names = next((names for names in PLACES if all(name in known for name in names)), ())
    return np.column_stack([known[name] for name in names]) if names else np.zeros((len(data), 0))


def groups(data: Dataset) -> np.ndarray:
    """The group of each frame, (frames,) integers from 0.

    Frames of one recording (`group`) are one group. Without recordings those at one place are, whatever their
    loads, and where no place is known each frame is a group of its own, as frames without contact are.
    """
    if data.group is not None:
        return np.unique(data.group, return_inverse=True)[1]
    found, apart = places(data), np.arange(len(data))
    if not found.shape[1]:
        return apart
    of_place = np.unique(found.round(6), axis=0, return_inverse=True)[1].reshape(-1)
    touching = ~np.isnan(found).any(axis=1)
    return np.unique(np.where(touching, of_place, len(data) + apart), return_inverse=True)[1]


def several_recordings(data: Dataset) -> bool:
    """Whether the frames that are not of the test split are of at least two recordings."""
    return data.group is not None and len(np.unique(data.group[data.split != "test"])) > 1


def left_out_together(data: Dataset) -> np.ndarray:
    """Which frames a model must not have seen that is judged on one of them, (frames,) integers from 0, the
    same for such frames; -1 in the test split.

    Those of its recording or, where there is one alone or none is named, those of its stretch of neighbouring
    frames, one of STRETCHES. They are of the same object, and say less than another recording would.
    """
    found, known = np.full(len(data), -1), np.flatnonzero(data.split != "test")
    if several_recordings(data):
        found[known] = np.unique(data.group[known], return_inverse=True)[1]
    else:
        found[known] = np.arange(len(known)) * STRETCHES // max(len(known), 1)
    return found
