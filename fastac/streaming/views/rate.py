"""How many frames a second a stream has."""

from collections import deque

WINDOW_NS = 1_000_000_000
LEAST_NS = 250_000_000
"""No rate is told before so much time has passed: the first frames come in a burst."""


class FrameRate:
    """Frames a second, over the last second of the host's clock."""

    def __init__(self):
        self._arrived: deque[tuple[int, int]] = deque()
        self._count = 0

    def add(self, now_ns: int, frames: int = 1) -> float | None:
        """The rate when `frames` more have come by `now_ns`; None before LEAST_NS have passed."""
        self._arrived.append((now_ns, frames))
        self._count += frames
        while len(self._arrived) > 2 and now_ns - self._arrived[1][0] > WINDOW_NS:
            self._count -= self._arrived.popleft()[1]
        begun, first = self._arrived[0]
        return None if now_ns < begun + LEAST_NS else 1e9 * (self._count - first) / (now_ns - begun)
