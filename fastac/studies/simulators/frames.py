"""Frames for the independent simulators: simulated ones, and photographs brought to their size."""

from pathlib import Path

import numpy as np
from PIL import Image

from fastac.sensor.importers.footage import photograph

PATTERN = "press/*.png"


def photographs(folder: Path, shape: tuple[int, int, int], count: int) -> np.ndarray:
    """`count` photographs below `folder`, evenly spread, as frames (count, H, W, C) uint8.

    shape : (H, W, C)
    They are resampled by exact area averaging; a fourth channel, for which a colour photograph has nothing,
    is the rounded mean of the three. Raises FileNotFoundError if there are too few.
    """
    height, width, channels = shape
    found = sorted(folder.glob(PATTERN))
    if len(found) < count:
        raise FileNotFoundError(f"{folder / PATTERN}: {len(found)} photographs: expected {count} or more")
    frames = np.empty((count, *shape), np.uint8)
    for k, place in enumerate(np.linspace(0, len(found) - 1, count).round().astype(int)):
        image = Image.fromarray(np.ascontiguousarray(photograph(found[place])))
        colours = np.asarray(image.resize((width, height), Image.Resampling.BOX))
        frames[k, ..., :3] = colours
        if channels == 4:
            frames[k, ..., 3] = colours.mean(axis=-1).round()
    return frames


def chosen(simulated: np.ndarray, count: int, photographed: np.ndarray) -> np.ndarray:
    """Photographs and `count` of the `simulated` frames, evenly spread, in turn; a photograph comes first."""
    places = np.linspace(0, len(simulated) - 1, count).round().astype(int)
    waiting = [list(photographed), list(simulated[places])]
    frames = []
    while any(waiting):
        frames += [kind.pop(0) for kind in waiting if kind]
    return np.array(frames)
