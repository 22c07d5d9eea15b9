"""Time stamps of a source's frames, and the pace at which a recording is played.

A camera's frames are stamped when they arrive, in ns since 1970. The frames of a recording are stamped from
their number and the recording's rate, k / frames_per_second after `start_ns`: the same in every run.
"""

import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

Stamped = tuple[int, np.ndarray]
"""A frame's time stamp in ns, and the frame."""
DEFAULT_FPS = 100.0
"""Frames a second by which a recording is stamped that does not say its own rate."""
SECOND_NS = 1_000_000_000


def arriving(frames: Iterable[np.ndarray], now_ns: Callable[[], int] = time.time_ns) -> Iterator[Stamped]:
    """Frames of a camera, stamped when they arrive."""
    for frame in frames:
        yield now_ns(), frame


def recorded(
    frames: Iterable[np.ndarray],
    frames_per_second: float = DEFAULT_FPS,
    *,
    start_ns: int = 0,
    paced: bool = False,
) -> Iterator[Stamped]:
    """Frames of a recording, stamped from their number.

    paced : give each frame when its time has come, as a camera would; else as fast as they are taken
    Raises ValueError unless the rate is above 0.
    """
    if not 0 < frames_per_second < float("inf"):
        raise ValueError(f"frames_per_second = {frames_per_second}: expected a number above 0")
    begun = time.monotonic()
    for k, frame in enumerate(frames):
        if paced and (wait := begun + k / frames_per_second - time.monotonic()) > 0:
            time.sleep(wait)
        yield start_ns + round(k * SECOND_NS / frames_per_second), frame
