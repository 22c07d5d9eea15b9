"""Loops compiled by Numba, whose machine code is kept for the next process until what it is made of changes.

Numba compiles a loop anew when the loop's own file has changed, not when a function, an intrinsic or a
constant of another file has: after an update it would go on with the old code of these, and find wrong
numbers. So here the code is kept in folders, one for each state of the files that a loop's module imports.
"""

import hashlib
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

from numba import config, njit
from numba.core.dispatcher import Dispatcher

FOLDER = Path(__file__).resolve().parents[1] / "__pycache__" / "loops"
"""Where the code is kept, unless the environment variable NUMBA_CACHE_DIR says another place; where it cannot
be written, in the user's folder of caches."""
KEPT_DAYS = 7
"""How long the code of an earlier state of the files is kept: branches take turns, and processes may still
write it."""
_IMPORT = re.compile(r"^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]+)|import\s+([\w.]+))", re.MULTILINE)

_lock = threading.Lock()


def compiled(**options) -> Callable[[Callable], Dispatcher]:
    """`numba.njit` that releases the interpreter's lock and keeps the machine code; options are those of
    `njit`."""

    def decorate(loop: Callable) -> Dispatcher:
        with _lock:
            before = config.CACHE_DIR
            base = _base(before)
            if base is None:
                return njit(nogil=True, **options)(loop)
            config.CACHE_DIR = str(_folder(base, loop.__module__))  # read where `njit` is applied
            try:
                return njit(nogil=True, cache=True, **options)(loop)
            finally:
                config.CACHE_DIR = before

    return decorate


@cache
def _base(wanted: str) -> Path | None:
    """The first folder that can be written: that of NUMBA_CACHE_DIR, if any, this project's, the user's."""
    of_user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fastac" / "loops"
    for folder in (Path(wanted) if wanted else FOLDER, of_user):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return None


@cache
def _folder(base: Path, module: str) -> Path:
    """The folder for the loops of a module in its present state; those of much earlier states are removed."""
    place = hashlib.sha256(str(sys.modules[module].__file__).encode()).hexdigest()[:8]
    name = f"{module}-{place}-"
    folder = base / f"{name}{_digest(module)}"
    if not folder.exists():
        for old in base.glob(f"{name}*"):
            if _age_s(old) > KEPT_DAYS * 86_400:
                shutil.rmtree(old, ignore_errors=True)
    return folder


def _age_s(folder: Path) -> float:
    """Since something was written there; 0 where it is gone."""
    try:
        return time.time() - folder.stat().st_mtime
    except OSError:
        return 0.0


def _digest(module: str) -> str:
    """Of the files of a module and of all modules of its package that it imports at its top, and they in
    turn."""
    package, found, waiting = module.partition(".")[0], {}, [module]
    while waiting:
        name = waiting.pop()
        path = getattr(sys.modules.get(name), "__file__", None)
        if name in found or path is None or name.partition(".")[0] != package:
            continue
        found[name], imported = _read(path)
        waiting += imported
    return hashlib.sha256("\n".join(map(str, sorted(found.items()))).encode()).hexdigest()[:16]


@cache
def _read(path: str) -> tuple[str, tuple[str, ...]]:
    """The digest of a module's file, and what it imports."""
    text = Path(path).read_text(encoding="utf-8")
    return hashlib.sha256(text.encode()).hexdigest(), (*_imports(text),)


def _imports(text: str) -> Iterator[str]:
    """Modules that statements at the top of a source name, and names in them that may be modules too."""
    for base, names, alone in _IMPORT.findall(text):
        if alone:
            yield alone
            continue
        yield base
        yield from (f"{base}.{name}" for name in re.findall(r"\w+", names))
