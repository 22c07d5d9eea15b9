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
from contextlib import suppress
from functools import cache
from pathlib import Path

from numba import config, njit
from numba.core.dispatcher import Dispatcher

FOLDER = Path(__file__).resolve().parents[1] / "__pycache__" / "loops"
"""Where the code is kept, unless the environment variable NUMBA_CACHE_DIR says another place; where it cannot
be written, in the user's folder of caches."""
KEPT_DAYS = 7
"""How long the code of a state of the files is kept after its last use: branches take turns."""
_IMPORT = re.compile(r"^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]+)|import\s+([^\n]+))", re.MULTILINE)
_STARTED_S = time.time()

_lock = threading.Lock()


def compiled(**options) -> Callable[[Callable], Dispatcher]:
    """`numba.njit` that releases the interpreter's lock and keeps the machine code; options are those of
    `njit`."""

    def decorate(loop: Callable) -> Dispatcher:
        with _lock:
            before = config.CACHE_DIR
            folder = _folder(_base(before), loop.__module__)
            if folder is None:
                return njit(nogil=True, **options)(loop)
            config.CACHE_DIR = str(folder)  # read where `njit` is applied
            try:
                return njit(nogil=True, cache=True, **options)(loop)
            finally:
                config.CACHE_DIR = before

    return decorate


@cache
def _base(wanted: str) -> Path | None:
    """The first folder that can be written: that of NUMBA_CACHE_DIR, if any, this project's, the user's."""
    of_user = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    for place in (wanted or str(FOLDER), f"{of_user}/fastac/loops"):
        try:
            folder = Path(place).expanduser()
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # it cannot be made, or there is no home
            continue
        if os.access(folder, os.W_OK):
            return folder
    return None


@cache
def _folder(base: Path | None, module: str) -> Path | None:
    """The folder for the loops of a module in its present state; those of states that were not used for long
    are removed. None where nothing can be kept."""
    digest = _digest(module)
    if base is None or digest is None:
        return None
    place = hashlib.sha256(str(sys.modules[module].__file__).encode()).hexdigest()[:8]
    folder = base / f"{module}-{place}-{digest}"
    with suppress(OSError):
        folder.mkdir(exist_ok=True)
        os.utime(folder)
        for old in base.glob(f"{module}-{place}-*"):
            if time.time() - old.stat().st_mtime > KEPT_DAYS * 86_400:
                shutil.rmtree(old, ignore_errors=True)
    return folder


def _digest(module: str) -> str | None:
    """Of the files of a module and of all modules of this project, and of its own package, that it imports at
    its top, and they in turn. None where one has no file that can be read, or one that was written since this
    process began: it may run what the file held before."""
    packages = {module.partition(".")[0], __name__.partition(".")[0]}
    found, waiting = {}, [module]
    while waiting:
        name = waiting.pop()
        if name in found or name not in sys.modules or name.partition(".")[0] not in packages:
            continue
        read = _read(getattr(sys.modules[name], "__file__", None))
        if read is None:
            return None
        found[name], imported = read
        waiting += imported
    return hashlib.sha256("\n".join(map(str, sorted(found.items()))).encode()).hexdigest()[:16]


@cache
def _read(file: str | None) -> tuple[str, tuple[str, ...]] | None:
    """The digest of a module's file and what it imports; None as in `_digest`."""
    try:
        path = Path(file)
        text = path.read_text(encoding="utf-8")
        if path.stat().st_mtime > _STARTED_S:
            return None
    except (TypeError, OSError, UnicodeDecodeError):
        return None
    return hashlib.sha256(text.encode()).hexdigest(), (*imports_at_top(text),)


def imports_at_top(text: str) -> Iterator[str]:
    """Modules that statements at the top of a source name, and names in them that may be modules too; not
    relative ones, nor those of other statements."""
    for base, names, several in _IMPORT.findall(text):
        if several:
            yield from re.findall(r"[\w.]+", several)
        else:
            yield base
            yield from (f"{base}.{name}" for name in re.findall(r"\w+", names))
