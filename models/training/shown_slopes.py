"""Whether labelled slopes are those that the frames show: a check of labels that needs no training.

The two combinations of channels that are nearest to slopes of a surface come from frames alone
(models/training/force/integrability.py). Labels of a mirrored image, or with x and y exchanged, do not follow
them.
"""

import numpy as np

from fastac.models.integer.light_level import levelled
from fastac.models.training.force.integrability import integrable_mixtures
from fastac.sensor.dataset import Dataset

MOST_FRAMES = 64
"""That are looked at, evenly chosen."""
CLEAR = 0.3
"""Correlations of at least this say something."""


def agreement(data: Dataset) -> np.ndarray | None:
    """Correlations (2, 2) of the slopes p and q that the frames show with the labelled ones, in valid pixels.

    Rows: shown p and q, columns: labelled p and q. The sign that shown slopes have in common is chosen so
    that the larger of both diagonal elements is positive. None without labels, with one channel, or where
    nothing differs.
    """
    if data.normals is None or data.frames.shape[-1] < 2:
        return None
    known = np.ones(data.frames.shape[:3], bool) if data.valid is None else data.valid
    labelled = np.flatnonzero(known.any(axis=(1, 2)))
    if not len(labelled):
        return None
    index = labelled[:: -(-len(labelled) // MOST_FRAMES)]
    frames, where = data.frames[index], known[index]
    level = levelled(frames, data.background)
    change = level.astype(np.float32) - data.background
    normals = data.normals[index][where].astype(np.float64)
    shown = (change @ integrable_mixtures(change).T)[where]
    slopes = -normals[:, :2] / normals[:, 2:]
    if not (shown.std(axis=0).all() and slopes.std(axis=0).all()):
        return None
    found = np.corrcoef(shown.T, slopes.T)[:2, 2:]
    diagonal = np.diagonal(found)
    return found * np.sign(diagonal[np.abs(diagonal).argmax()])


def doubt(found: np.ndarray) -> str | None:
    """What `agreement` says against the labels, or None."""
    diagonal, others = np.diagonal(found), np.abs(found[[0, 1], [1, 0]])
    if others.min() > max(np.abs(diagonal).max(), CLEAR):
        return "x and y of the labels seem exchanged"
    if diagonal.min() < -CLEAR:
        return "the labels seem mirrored along one axis"
    return None
