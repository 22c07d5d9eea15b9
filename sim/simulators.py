"""Simulators kept by what they are made of, so that the same Verilog is compiled once."""

import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

CACHE = Path("build/cache/simulators")
"""Executables by the hash of their sources, commands and tools."""
LIMIT_BYTES = 2 << 30
"""Those that nobody has used for longest go as soon as all together take more."""


def digest(*content: object) -> str:
    """A name for what a simulator is made of."""
    return hashlib.sha256(repr(content).encode()).hexdigest()[:32]


def take_or_make(name: str, executable: Path, make: Callable[[], None]) -> bool:
    """Put the simulator `name` at `executable`; `make()` builds it there where none is kept.

    Returns whether it was kept already. Processes that want the same one wait for the first; a build that
    fails or is killed keeps nothing.
    """
    CACHE.mkdir(parents=True, exist_ok=True)
    kept = CACHE / name
    executable.unlink(missing_ok=True)  # or make might take another simulator's for its own
    with FileLock(f"{kept}.lock"):
        if kept.exists():
            os.utime(kept)
            shutil.copy2(kept, executable)
            return True
        make()
        part = kept.with_suffix(".part")
        shutil.copy2(executable, part)
        os.utime(part)
        part.replace(kept)
    _forget_oldest()
    return False


def _forget_oldest() -> None:
    """Delete those that were used longest ago until the rest is within the limit."""
    with FileLock(CACHE / "clean.lock"):
        files = [path for path in CACHE.iterdir() if not path.suffix]
        found = sorted((path.stat().st_mtime, path.stat().st_size, path) for path in files)
        excess = sum(size for _, size, _ in found) - LIMIT_BYTES
        for _, size, path in found:
            if excess <= 0:
                break
            path.unlink(missing_ok=True)
            Path(f"{path}.lock").unlink(missing_ok=True)
            excess -= size
