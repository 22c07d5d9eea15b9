"""Running another maker's program with its output in a file, and its progress read from that file."""

import subprocess
from pathlib import Path

from fastac.sim.independent.outcome import SimulatorError
from fastac.store.progress import watched

TAIL = 2000
"""Characters at the end of a log in which the last clock is looked for."""


def _clock(log: Path) -> int:
    """The last clock that a bench has printed."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - TAIL))
        lines = [line.split() for line in file.read().splitlines()[:-1]]
    return next((int(line[1]) for line in reversed(lines) if line[:1] == [b"CLOCK"]), 0)


def run(
    command: list[str], folder: Path, log: str, *, label: str, total: int | None = None, progress: bool
) -> str:
    """Run a command in `folder`; returns what it has printed, which `log` keeps.

    total : clocks of a bench, for the progress bar
    Raises SimulatorError with its first line if it fails.
    """
    path = folder / log
    with path.open("w") as output:
        position = None if total is None else lambda: _clock(path)
        with watched(label, enabled=progress, total=total, unit="clock", position=position):
            done = subprocess.run(command, cwd=folder, stdout=output, stderr=subprocess.STDOUT, check=False)
    text = path.read_text(errors="replace")
    if done.returncode:
        reason = (text.strip().splitlines() or [f"exit status {done.returncode}"])[0]
        raise SimulatorError(f"{command[0]}: {reason}")
    return text
