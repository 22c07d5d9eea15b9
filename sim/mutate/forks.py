"""Trials in forked processes: each begins where its parent stands and ends with a verdict."""

import os
import resource
import signal
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

PASSED, FAILED = 0, 1
LEAST_LIMIT_S = 2
SLOWER = 4
"""A trial may use this many times the processor time of the unchanged design, and LEAST_LIMIT_S anyway."""


@dataclass(frozen=True)
class Trial:
    """What became of a forked process."""

    verdict: str
    """"passed", "failed", "hang" (out of processor time) or "crash"."""
    cpu_s: float
    message: bytes = b""


def limit_s(good_cpu_s: float) -> int:
    """Processor time for a mutant, from that of the unchanged design."""
    return max(LEAST_LIMIT_S, int(SLOWER * good_cpu_s) + 1)


class Branch:
    """A fork of this process. In the child `is_child` is set, and the parent waits for it with `trial()`."""

    def __init__(self, cpu_limit_s: int | None = None):
        descriptor, path = tempfile.mkstemp()
        os.close(descriptor)
        self._message = Path(path)
        self._pid = os.fork()
        self.is_child = self._pid == 0
        if self.is_child:
            if cpu_limit_s is not None:
                resource.setrlimit(resource.RLIMIT_CPU, (cpu_limit_s, cpu_limit_s + 2))
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 1)
            os.dup2(nothing, 2)

    def end(self, verdict: int, message: bytes = b"") -> None:
        """End the child."""
        self._message.write_bytes(message)
        os._exit(verdict)

    def trial(self) -> Trial:
        """Wait for the child."""
        _, status, usage = os.wait4(self._pid, 0)
        message = self._message.read_bytes()
        with suppress(FileNotFoundError):
            self._message.unlink()
        code = os.waitstatus_to_exitcode(status)
        verdict = {PASSED: "passed", FAILED: "failed", -signal.SIGXCPU: "hang"}.get(code, "crash")
        return Trial(verdict, usage.ru_utime + usage.ru_stime, message)


def in_fork(work: Callable[[], bytes]) -> Trial:
    """Run `work` in a forked process; its result is the trial's message."""
    branch = Branch()
    if branch.is_child:
        try:
            branch.end(PASSED, work())
        except BaseException as error:
            branch.end(FAILED, repr(error).encode())
    return branch.trial()
