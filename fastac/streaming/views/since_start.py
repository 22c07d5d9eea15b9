"""How long ago this process began."""

import os
import time
from pathlib import Path

_IMPORTED_NS = time.time_ns()


def started_ns() -> int:
    """When this process began, ns since 1970; where that is not known, when this module was imported."""
    try:
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        ticks = int(fields[19])  # of the system's clock since it was started
        booted_ns = time.time_ns() - time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        return booted_ns + ticks * 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return _IMPORTED_NS


def since_start_s(at_ns: int) -> float:
    """Seconds from the beginning of this process until `at_ns`, ns since 1970."""
    return (at_ns - started_ns()) / 1e9
