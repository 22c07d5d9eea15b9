"""Loops compiled by Numba, whose machine code is kept for the next process until what it is made of changes.

Numba compiles a loop anew when the loop's own file has changed, not when a function or constant of another
file has: after an update it would go on with the old code of these, and find wrong numbers. So here each
state of a loop and of all that it uses has a folder of its own.
"""

import hashlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType

import numpy as np
from numba import config, njit
from numba.core.dispatcher import Dispatcher

FOLDER = Path(__file__).resolve().parents[1] / "__pycache__" / "loops"
"""Where the code is kept, unless the environment variable NUMBA_CACHE_DIR says another place. Where it cannot
be written, Numba chooses one."""
Plain = bool | int | float | complex | str | bytes | None | np.generic

_digests: dict[Callable, str] = {}


def compiled(**options) -> Callable[[Callable], Dispatcher]:
    """`numba.njit` that releases the interpreter's lock and keeps the machine code; options are those of
    `njit`.

    What a loop uses of its own file must stand above it; what stands below is known by the file's time alone.
    """

    def decorate(loop: Callable) -> Dispatcher:
        _digests[loop] = digest = _digest(loop)
        before = config.CACHE_DIR
        folder = _folder(Path(before) if before else FOLDER, loop, digest)
        config.CACHE_DIR = str(folder)  # read where `njit` is applied
        try:
            return njit(nogil=True, cache=True, **options)(loop)
        finally:
            config.CACHE_DIR = before

    return decorate


def _folder(base: Path, loop: Callable, digest: str) -> Path:
    """The folder of a loop's present state; those of its earlier states are removed."""
    name = f"{loop.__module__}.{loop.__qualname__}-"
    folder = base / f"{name}{digest}"
    if not folder.exists():
        for old in base.glob(f"{name}*"):
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _digest(loop: Callable) -> str:
    names: set[str] = set()
    texts = [*_texts_of_code(loop.__code__, names)]
    known = loop.__globals__
    texts += [f"{name}={_text(known[name])}" for name in sorted(names & known.keys())]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]


def _texts_of_code(code: CodeType, names: set[str]) -> Iterator[str]:
    """The instructions and constants of code and of what is nested in it; its names are added to `names`."""
    names.update(code.co_names)
    yield code.co_code.hex()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _texts_of_code(constant, names)
        else:
            yield _text(constant)


def _text(value: object) -> str:
    """What a loop takes from a value that it uses: of a constant the value, of a loop its digest, of a tuple
    class its fields, of anything else the name, since that is a library's."""
    if isinstance(value, Dispatcher):
        return _digests.get(value.py_func) or _digest(value.py_func)
    if isinstance(value, Plain):
        return repr(value)
    if isinstance(value, tuple):
        return f"({', '.join(map(_text, value))})"
    if isinstance(value, frozenset):
        return f"{{{', '.join(sorted(map(_text, value)))}}}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    fields = getattr(value, "_fields", "")
    return (
        f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value).__name__)}{fields}"
    )
