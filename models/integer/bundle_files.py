"""Where a bundle's files are: in a folder, or in one file that is read without unpacking it.

The one file is a zip archive whose members are, each once:

    manifest.json    format, format_version, fastac_version, bundle_sha256; bytes and sha256 of the others
    card.json        what the sensor is, what it was trained on, how large its errors are, the licence
    README.md        the same, to read
    bundle.json, integers.npz, floats.npz    the files of the folder, unchanged

Nothing is unpickled, nothing is written, and sizes are checked before anything is decompressed.
"""

import hashlib
import io
import json
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.scenes.schema import shown
from fastac.store.files import (
    DAMAGE,
    MAX_DEFLATE_RATIO,
    DamagedFileError,
    inside,
    load_arrays,
)

JSON_FILE, INTEGERS, FLOATS = "bundle.json", "integers.npz", "floats.npz"
NAMES = (JSON_FILE, INTEGERS, FLOATS)
SUFFIX = ".fastac"
MANIFEST, CARD, README = "manifest.json", "card.json", "README.md"
FORMAT, ARCHIVE_VERSION = "fastac bundle", 1
MOST_BYTES = 256 << 20
"""Of a single file, of all its members together, and of all arrays in one of them."""
MOST_OF_DIRECTORY = 1 << 16
"""Bytes of the archive's directory; six members need less than 500."""
_END, _END64 = b"PK\x05\x06", b"PK\x06\x07"
_END_BYTES, _END64_BYTES = 22, 20


class BundleError(ValueError):
    """A bundle that cannot be used; the message is one line that names file, key and value."""


def version_error(place: str, version: object, readable: tuple[int, ...]) -> BundleError:
    """The error of a file of another format version than this fastac can read."""
    expected = " or ".join(map(str, readable))
    hint = ""
    if type(version) is int:
        newer = version > max(readable)
        age = "a newer fastac" if newer else "an older fastac, whose bundles are no longer read"
        hint = f"; it was written by {age}"
    return BundleError(f"{place}: format_version = {shown(version)}: expected {expected}{hint}")


@dataclass(frozen=True)
class Folder:
    """A bundle's files in a folder. Links out of it are not followed."""

    path: Path
    digest: str | None = None
    """SHA-256 that the bundle must have; unknown here."""

    def place(self, name: str) -> str:
        """The file's name in error messages."""
        return str(self.path / name)

    def content(self) -> bytes:
        """The bytes of bundle.json."""
        try:
            return self._inside(JSON_FILE).read_bytes()
        except FileNotFoundError:
            text = f"no such file; is {self.path} a bundle folder?"
            raise BundleError(f"{self.place(JSON_FILE)}: {text}") from None
        except OSError as error:
            raise BundleError(f"{self.place(JSON_FILE)}: not readable JSON: {error}") from None

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        try:
            return load_arrays(self._inside(name))
        except FileNotFoundError:
            raise BundleError(f"{self.place(name)}: no such file") from None
        except DamagedFileError as error:
            raise BundleError(str(error)) from None
        except OSError as error:
            raise BundleError(f"{self.place(name)}: {error.strerror or error}") from None

    def _inside(self, name: str) -> Path:
        try:
            return inside(self.path, name)
        except DamagedFileError as error:
            raise BundleError(str(error)) from None


@dataclass(frozen=True)
class Archive:
    """A bundle's files out of a single file, checked against its manifest."""

    path: Path
    members: dict[str, bytes]
    digest: str
    """SHA-256 that the manifest says the bundle has."""

    def place(self, name: str) -> str:
        return f"{self.path}: {name}"

    def content(self) -> bytes:
        return self.members[JSON_FILE]

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        try:
            file = io.BytesIO(self.members[name])
            return load_arrays(file, name=self.place(name), most_bytes=MOST_BYTES)
        except DamagedFileError as error:
            raise BundleError(str(error)) from None


def open_files(path: Path) -> Folder | Archive:
    """The files of the bundle in a folder or a single file.

    Raises BundleError for a single file that is damaged or not there.
    """
    if path.suffix == SUFFIX and not path.exists():
        raise BundleError(f"{path}: no such file")
    return read_archive(path) if path.is_file() else Folder(path)


def read_archive(path: Path) -> Archive:
    """The members of a single file. Raises BundleError, naming the member at fault, unless all is well."""
    if path.suffix != SUFFIX:
        raise BundleError(f"{path}: not a bundle: expected a folder or a {SUFFIX} file")
    try:
        _check_end(path)
        with zipfile.ZipFile(path) as archive:
            return _read(path, archive)
    except BundleError:
        raise
    except OSError as error:
        raise BundleError(f"{path}: {error.strerror or shown(str(error))}") from None
    except DAMAGE as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise BundleError(f"{path}: damaged or no {SUFFIX} file ({shown(reason)})") from None


def _check_end(path: Path) -> None:
    """Raise BundleError where the archive, or the directory at its end, is larger than any of ours."""
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        if size > MOST_BYTES:
            raise BundleError(f"{path}: {size} bytes: expected at most {MOST_BYTES}")
        file.seek(max(size - _END_BYTES - _END64_BYTES, 0))
        tail = file.read()
    end = tail[-_END_BYTES:]
    plain = len(end) == _END_BYTES and end.startswith(_END) and not tail.startswith(_END64)
    if not plain or int.from_bytes(end[12:16], "little") > MOST_OF_DIRECTORY:
        raise BundleError(f"{path}: damaged or no {SUFFIX} file")


def _read(path: Path, archive: zipfile.ZipFile) -> Archive:
    found: dict[str, zipfile.ZipInfo] = {}
    for member in archive.infolist():
        if member.filename in found:
            raise BundleError(f"{path}: {shown(member.filename)}: is there twice")
        found[member.filename] = member
    if MANIFEST not in found:
        raise BundleError(f"{path}: {MANIFEST}: missing; not a bundle")
    total = sum(member.file_size for member in found.values())
    if total > MOST_BYTES:
        raise BundleError(f"{path}: {total} bytes are declared: expected at most {MOST_BYTES}")
    manifest = _manifest(path, _bytes(path, archive, found.pop(MANIFEST)))
    expected = {CARD, README, *NAMES}
    for name in sorted(expected ^ found.keys()):
        wrong = "missing" if name in expected else "unknown member"
        raise BundleError(f"{path}: {shown(name)}: {wrong}")
    members = {}
    for name, member in found.items():
        facts = manifest["files"].get(name)
        facts = facts if isinstance(facts, dict) else {}
        if facts.get("bytes") != member.file_size:
            raise BundleError(
                f"{path}: {name}: {member.file_size} bytes are declared, not {shown(facts.get('bytes'))}"
            )
        content = members[name] = _bytes(path, archive, member)
        stated = facts.get("sha256")
        digest = hashlib.sha256(content).hexdigest()
        if stated != digest:
            raise BundleError(
                f"{path}: {name}: sha256 is {digest}, not {shown(stated)}; it was changed or damaged"
            )
    return Archive(path, members, manifest["bundle_sha256"])


def _bytes(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """A member's content, whose size is no more than its compressed bytes can become."""
    place = f"{path}: {shown(member.filename)}"
    if member.file_size > MAX_DEFLATE_RATIO * member.compress_size:
        raise BundleError(f"{place}: {member.file_size} bytes of {member.compress_size} are declared")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise BundleError(f"{place}: compression {member.compress_type}: expected stored or deflated")
    try:
        return archive.read(member)
    except DAMAGE as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise BundleError(f"{place}: damaged ({shown(reason)})") from None


def _manifest(path: Path, content: bytes) -> dict:
    try:
        manifest = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BundleError(f"{path}: {MANIFEST}: not readable JSON: {shown(str(error))}") from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise BundleError(f"{path}: {MANIFEST}: format: expected {FORMAT!r}")
    if manifest.get("format_version") != ARCHIVE_VERSION:
        place = f"{path}: {MANIFEST}"
        raise version_error(place, manifest.get("format_version"), (ARCHIVE_VERSION,))
    for key, kind in (("files", dict), ("bundle_sha256", str)):
        if not isinstance(manifest.get(key), kind):
            raise BundleError(f"{path}: {MANIFEST}: {key} = {shown(manifest.get(key))}: not understood")
    return manifest
