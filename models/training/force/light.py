"""Frames as they would be under another light, so that what learns from them does not take light for force.

Lamps warm up and exposures differ from recording to recording. Some thousand pixels in sum take that for a
force, and few recordings do not teach a model that it is none. Each frame of a training therefore gets gains
of its own.
"""

from dataclasses import replace

import numpy as np

from fastac.sensor.dataset import Dataset

PIXEL_MAX = 255


def under_other_light(data: Dataset, noise: float, seed: int) -> Dataset:
    """The dataset with each channel of its training and validation frames multiplied by a random gain.

    noise : the gains' standard deviation, around 1; with 0 the dataset itself is returned
    Gains follow from the seed and the frame's place in the dataset alone. Products are rounded, and saturate
    as a camera does. Background and test frames stay.
    """
    if not noise:
        return data
    count, *_, channels = data.frames.shape
    gains = 1 + noise * np.random.default_rng(seed).standard_normal((count, channels))
    relit = data.frames.copy()
    for k in np.flatnonzero(data.split != "test"):
        relit[k] = np.clip(np.rint(relit[k] * gains[k]), 0, PIXEL_MAX)
    return replace(data, frames=relit)
