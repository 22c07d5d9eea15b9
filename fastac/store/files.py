"""Writing and reading files: whole or not at all, and with one-line errors that name a damaged file."""

import hashlib
import json
import lzma
import math
import os
import secrets
import shutil
import struct
import tempfile
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

DAMAGE = (
    *(ValueError, EOFError, KeyError, AttributeError, TypeError, SyntaxError, RuntimeError, OverflowError),
    *(
        MemoryError,
        IndexError,
        struct.error,
        tokenize.TokenError,
        zipfile.BadZipFile,
        zlib.error,
        lzma.LZMAError,
    ),
)
"""What NumPy and zipfile raise for archives that are cut short, overwritten, or none."""
MAX_DEFLATE_RATIO = 1032
"""Most bytes that a byte of a compressed archive can become."""


class DamagedFileError(ValueError):
    """A file that cannot be read as what its name says; the message is one line that names it."""


def digest_file(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_hash(*values: object) -> str:
    """SHA-256 of values that JSON can express; keys of objects are sorted."""
    text = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder, which replaces `path` when the block ends without an exception."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays last: numpy and Matplotlib choose a format by it.
    temporary = path.with_name(f".{path.stem}.{os.getpid()}-{secrets.token_hex(4)}.part{path.suffix}")
    try:
        yield temporary
        temporary.chmod(0o644)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def write_folder_atomically(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path`, which replaces it when the block ends without an exception."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    try:
        yield temporary
        temporary.chmod(0o755)
        if path.exists():
            shutil.rmtree(path)
        os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    with write_atomically(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, content: object, *, indent: int | None = 2) -> None:
    write_text(path, json.dumps(content, indent=indent) + "\n")


def read_json(path: Path) -> object:
    """Raises DamagedFileError for what is no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(f"{path}: damaged or no JSON ({error})") from None


def save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays as compressed .npz; equal arrays give equal bytes."""
    with write_atomically(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)


def load_arrays(
    source: Path | BinaryIO, *, name: str | None = None, most_bytes: int | None = None
) -> dict[str, np.ndarray]:
    """The arrays of an .npz; raises DamagedFileError for anything else.

    source : a path, or an open file that errors call `name`
    most_bytes : what the arrays may need together, of an archive that came from elsewhere
    """
    try:
        with zipfile.ZipFile(source) as archive:
            total = sum(each.file_size for each in archive.infolist())
            if most_bytes is not None and total > most_bytes:
                raise ValueError(f"{total} bytes are declared, more than {most_bytes}")
            return {each.filename.removesuffix(".npy"): _member(archive, each) for each in archive.infolist()}
    except (*DAMAGE, OSError) as error:
        if isinstance(error, OSError) and error.filename is not None:  # it could not be opened
            raise
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise DamagedFileError(f"{name or source}: damaged or no .npz file ({reason})") from None


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """Raises ValueError where the archive declares more than its bytes can become."""
    if member.file_size > MAX_DEFLATE_RATIO * member.compress_size:
        raise ValueError(f"{member.filename!r}: {member.file_size} bytes of {member.compress_size}")
    with archive.open(member) as file:
        return read_npy(file, member.file_size)


def load_array(path: Path) -> np.ndarray:
    """The array of an .npy; raises DamagedFileError for anything else, and FileNotFoundError."""
    try:
        with open(path, "rb") as file:
            return read_npy(file, path.stat().st_size)
    except FileNotFoundError:
        raise
    except DAMAGE as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise DamagedFileError(f"{path}: not a readable array: {reason}") from None


def read_npy(file: BinaryIO, size: int) -> np.ndarray:
    """The array in the .npy format in an open file of `size` bytes, without unpickling.

    Raises ValueError, and what NumPy raises, before anything is allocated where it declares another size.
    """
    version = np.lib.format.read_magic(file)
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    shape, _, dtype = read_header[version](file)
    declared, left = math.prod(shape) * dtype.itemsize, size - file.tell()
    if dtype.hasobject:
        raise ValueError("Object arrays cannot be loaded")
    if not dtype.itemsize or min(shape, default=0) < 0 or declared != left:
        raise ValueError(f"{shape} of {dtype}: {declared} bytes are declared, {left} follow")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)


def inside(folder: Path, name: str) -> Path:
    """The path of a file in a folder that came from elsewhere.

    Raises DamagedFileError where the name, or a symbolic link, leads out of the folder.
    """
    try:
        is_inside = (folder / name).resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # zero bytes, circles of links
        is_inside = False
    if not is_inside:
        raise DamagedFileError(f"{folder}: {name!r}: not a file inside this folder")
    return folder / name
