"""Content-addressed cache of simulators: the same Verilog, flags and tools are compiled only once."""

import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

CACHE = Path("build/cache/simulators")
"""Executables by the hash of their sources, commands and tools."""
LIMIT_BYTES = 2 << 30
"""Above this total size the least recently used executables are deleted."""


def digest(*content: object) -> str:
    """Hash of everything that a simulator is built from."""
    return hashlib.sha256(repr(content).encode()).hexdigest()[:32]


def copy_or_build(name: str, executable: Path, build: Callable[[], None]) -> bool:
    """Copy the simulator with hash `name` from the cache to `executable`; if it is missing, call `build()`.

    `build()` must build `executable`, which then enters the cache. Returns whether it was in the cache.
    Processes that need the same simulator wait for the first; a failed or killed build leaves no entry.
    """
    CACHE.mkdir(parents=True, exist_ok=True)
    cached = CACHE / name
    # make would take another simulator's executable for its own.
    executable.unlink(missing_ok=True)
    with FileLock(f"{cached}.lock"):
        if cached.exists():
            os.utime(cached)
            shutil.copy2(cached, executable)
            return True
        build()
        part = cached.with_suffix(".part")
        shutil.copy2(executable, part)
        os.utime(part)
        part.replace(cached)
    _delete_least_recently_used()
    return False


def _delete_least_recently_used() -> None:
    """Delete the least recently used simulators until the rest is within LIMIT_BYTES."""
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
