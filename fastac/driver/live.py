"""What a run shows while it runs and at its end: forces, flags, frame rate and latency."""

import math
import sys
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import TextIO

import numpy as np

from fastac.driver.packets import Found

TERMINAL_S, FILE_S = 0.1, 1.0
"""Between two states of the line on a terminal, and between two lines elsewhere."""
WINDOW = 64
"""Results over which the rate that is shown is taken."""
KEPT = 100_000
"""Latest latencies of which the summary has median and percentile."""


class StatusLine:
    """Text on `stream` now and then: one refreshed line on a terminal, a line a second elsewhere."""

    def __init__(self, stream: TextIO | None = None, *, enabled: bool = True):
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._enabled = enabled
        self._shown = -math.inf  # so that the first text is shown
        self._width = 0

    def show(self, text: Callable[[], str]) -> None:
        """Show what `text` gives, if it is time to."""
        now = time.monotonic()
        if not self._enabled or now - self._shown < (TERMINAL_S if self._terminal else FILE_S):
            return
        self._shown, shown = now, text()
        if self._terminal:
            self._stream.write("\r" + shown.ljust(self._width))
            self._width = len(shown)
        else:
            self._stream.write(shown + "\n")
        self._stream.flush()

    def close(self) -> None:
        """End the refreshed line."""
        if self._width:
            self._stream.write("\n")
            self._width = 0


class Rate:
    """Results a second of wall-clock time, over the latest of them."""

    def __init__(self):
        self._arrived: deque[float] = deque(maxlen=WINDOW)

    def add(self) -> None:
        self._arrived.append(time.monotonic())

    def __float__(self) -> float:
        if len(self._arrived) < 2:
            return 0.0
        return (len(self._arrived) - 1) / max(self._arrived[-1] - self._arrived[0], 1e-9)


class Live:
    """Shows each result on `stream`: one refreshed line on a terminal, a line a second elsewhere."""

    def __init__(self, stream: TextIO | None = None, *, enabled: bool = True):
        self._line = StatusLine(stream, enabled=enabled)
        self._start = time.monotonic()
        self._rate = Rate()
        self._latencies: deque[float] = deque(maxlen=KEPT)
        self._counts: Counter[str] = Counter()
        self._last: Found | None = None

    def add(self, found: Found) -> None:
        self._rate.add()
        self._counts["frames"] += 1
        for name in ("lost", "bad", "suspect", "slipping"):
            self._counts[name] += bool(getattr(found, name))
        if not found.lost:
            self._last = found
            self._latencies.append(float(found.host_latency_s))
        self._line.show(lambda: line(found, float(self._rate)))

    def close(self) -> None:
        """End the refreshed line."""
        self._line.close()

    def summary(self) -> list[str]:
        """Lines about the whole run."""
        counts, seconds = self._counts, time.monotonic() - self._start
        slips = ("slipping",) if self._last is not None and self._last.description.slip else ()
        flagged = ", ".join(f"{counts[name]} {name}" for name in ("lost", "bad", "suspect", *slips))
        lines = [f"{counts['frames']} frames in {seconds:.1f} s: {flagged}"]
        if self._last is not None:
            middle, high = (1e3 * np.quantile(self._latencies, q) for q in (0.5, 0.99))
            clocks = int(self._last.records["first_to_result"])
            ms = 1e3 * float(self._last.first_pixel_to_result_s)
            lines += [
                f"{counts['frames'] / max(seconds, 1e-9):.1f} frames/s",
                f"first pixel to result in the hardware: {clocks} clocks, {ms:.3f} ms",
                f"host, from sending a frame to having its result: median {middle:.3f} ms, 99% {high:.3f} ms",
            ]
        return lines


def line(found: Found, rate: float) -> str:
    """One result in one line."""
    if found.lost:
        return f"frame {int(found.frame)}  LOST  {rate:.1f} frames/s"
    parts = [f"frame {int(found.frame)}"]
    if found.force_axes:
        halves = found.force_half_width_n
        around = [""] * len(found.force_axes) if halves is None else [f" ± {half:.3f}" for half in halves]
        forces = zip(found.force_axes, found.force_n, around, strict=True)
        parts.append("  ".join(f"F_{axis} {force:+.3f}{half} N" for axis, force, half in forces))
    if found.depth_mm is not None:
        depth = found.depth_mm
        parts.append(f"depth {depth.min():.3f} to {depth.max():.3f} mm")
    if found.slip_px is not None:
        parts.append(f"slip {float(found.slip_px):.2f} px")
    flags = [name for name in ("bad", "slipping") if getattr(found, name)]
    if found.suspect:
        flags.append(f"suspect ({', '.join(found.reasons)})")
    parts.append(", ".join(flags) or "ok")
    parts.append(f"{rate:.1f} frames/s")
    parts.append(f"{1e3 * float(found.first_pixel_to_result_s):.3f} ms in hardware")
    parts.append(f"{1e3 * float(found.host_latency_s):.3f} ms to the host")
    return "  ".join(parts)
