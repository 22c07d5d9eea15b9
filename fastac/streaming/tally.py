"""What a stream shows while it runs and at its end: forces, flags, frame rate and latency."""

import time
from collections import Counter, deque
from typing import TextIO

import numpy as np

from fastac.driver.live import KEPT, Rate, StatusLine
from fastac.streaming.record import StreamRecord

FLAGS = ("lost", "bad", "suspect", "slipping")


class Tally:
    """A sink that counts records, shows the latest one now and then, and has a summary at the end.

    The time of the summary begins when it is made.

    stream : where records are shown; None: standard error. enabled : whether they are
    """

    def __init__(self, stream: TextIO | None = None, *, enabled: bool = True):
        self.counts: Counter[str] = Counter()
        self._line = StatusLine(stream, enabled=enabled)
        self._rate = Rate()
        self._begun, self._ended = time.monotonic(), None
        self._latencies: deque[float] = deque(maxlen=KEPT)
        self._slips = False

    def add(self, record: StreamRecord) -> None:
        self._rate.add()
        self.counts["frames"] += 1
        for name in FLAGS:
            self.counts[name] += getattr(record, name)
        self._slips |= record.slip_px is not None
        if record.timing.host_latency_s is not None:
            self._latencies.append(record.timing.host_latency_s)
        self._line.show(lambda: line(record, float(self._rate)))

    def close(self) -> None:
        self._ended = time.monotonic()
        self._line.close()

    def summary(self) -> str:
        """The whole stream in one line: frames, flags, rate, and the host's latency from frame to result."""
        counts, seconds = self.counts, (self._ended or time.monotonic()) - self._begun
        if not counts["frames"]:
            return "0 frames"
        shown = FLAGS if self._slips else FLAGS[:-1]
        parts = [
            f"{counts['frames']} frames in {seconds:.1f} s",
            *(f"{counts[name]} {name}" for name in shown),
        ]
        parts.append(f"{counts['frames'] / max(seconds, 1e-9):.1f} frames/s")
        if self._latencies:
            middle, high = (1e3 * np.quantile(self._latencies, q) for q in (0.5, 0.99))
            parts.append(f"latency median {middle:.3f} ms, 99% {high:.3f} ms")
        return ", ".join(parts)


def line(record: StreamRecord, rate: float) -> str:
    """One record in one line."""
    if record.lost:
        return f"frame {record.frame}  LOST  {rate:.1f} frames/s"
    parts = [f"frame {record.frame}"]
    parts += [f"F_{axis} {force:+.3f} N" for axis, force in record.force_n.items()]
    if record.depth_mm is not None:
        parts.append(f"depth {record.depth_mm.min():.3f} to {record.depth_mm.max():.3f} mm")
    if record.slip_px is not None:
        parts.append(f"slip {record.slip_px:.2f} px")
    flags = [name for name in ("bad", "slipping") if getattr(record, name)]
    if record.suspect:
        flags.append(f"suspect ({', '.join(record.reasons)})")
    parts += [", ".join(flags) or "ok", f"{rate:.1f} frames/s"]
    return "  ".join(parts)
