"""Values and files as keys: a JSON form that keeps types apart, and digests of what a path holds."""

import os
import threading
from pathlib import Path

import numpy as np

from fastac.store.files import content_hash, digest_file


def plain(value: object) -> object:
    """A copy in which NumPy's scalars are Python's; raises TypeError for what JSON cannot express."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or type(value) in (bool, int, float, str):
        return value
    if type(value) in (list, tuple):
        return type(value)(plain(item) for item in value)
    if type(value) is dict:
        return {plain(key): plain(item) for key, item in value.items()}
    if type(value) in (set, frozenset):
        return type(value)(plain(item) for item in value)
    raise TypeError(f"{value!r} is a {type(value).__name__}; expected numbers, text, lists, tuples or dicts")


def encoded(value: object) -> object:
    """A JSON form of a plain value that differs wherever type, order or value differ."""
    if type(value) is tuple:
        return [encoded(item) for item in value]
    if type(value) is list:
        return {"list": [encoded(item) for item in value]}
    if type(value) is dict:
        return {"dict": [[encoded(key), encoded(item)] for key, item in value.items()]}
    if type(value) in (set, frozenset):
        return {"set": sorted((encoded(item) for item in value), key=content_hash)}
    return plain(value)


_known: dict[str, tuple[tuple[int, ...], str]] = {}
_lock = threading.Lock()


def stamp(path: str | Path) -> tuple[int, ...]:
    """What changes when a file is written or replaced: size, time of modification, inode."""
    status = os.stat(path)
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev


def path_digest(path: Path) -> str:
    """Digest of a file's content, or of a folder's names and contents.

    A file that keeps its stamp is read once per process.
    """
    if path.is_dir():
        files = sorted(p for p in path.rglob("*") if p.is_file())
        return content_hash([[p.relative_to(path).as_posix(), path_digest(p)] for p in files])
    key, now = os.path.abspath(path), stamp(path)
    with _lock:
        known = _known.get(key)
    if known and known[0] == now:
        return known[1]
    digest = digest_file(path)
    with _lock:
        _known[key] = now, digest
    return digest
