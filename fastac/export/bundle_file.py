"""A bundle in one file, to be shared: written the same byte for byte from the same bundle, and its card."""

import hashlib
import json
import re
import zipfile
from importlib.metadata import version
from pathlib import Path

from fastac.export.card import card_of, markdown
from fastac.models.integer import bundle as bundles
from fastac.models.integer.bundle_files import (
    ARCHIVE_VERSION,
    CARD,
    FORMAT,
    MANIFEST,
    NAMES,
    README,
    SUFFIX,
    Archive,
    BundleError,
    open_files,
)
from fastac.store.files import write_atomically

BEGINNING = (1980, 1, 1, 0, 0, 0)
"""The time stamp of every member, the earliest that a zip archive can have."""
SPDX = re.compile(r"[A-Za-z0-9.+-]+(?: (?:AND|OR|WITH) [A-Za-z0-9.+-]+)*")


def write_bundle_file(path: Path, output: Path, *, licence: str | None = None) -> str:
    """Write the bundle in a folder, a build folder or a single file to `output`; returns its SHA-256.

    licence : an SPDX expression for the card; None keeps a single file's own, and is else "not stated"
    Raises BundleError for a bundle that does not load, ValueError for another file name or licence.
    """
    if output.suffix != SUFFIX:
        raise ValueError(f"{output}: a single-file bundle's name ends in {SUFFIX}")
    if licence is not None and not SPDX.fullmatch(licence):
        raise ValueError(f"--licence {licence!r}: expected an SPDX expression such as CC-BY-4.0")
    bundle = bundles.load_bundle(path)
    files = open_files(bundles.bundle_folder(path))
    if isinstance(files, Archive):
        members = dict(files.members)
        if licence is not None:
            card = _card(files) | {"licence": licence}
            members |= {CARD: _json(card), README: markdown(card).encode()}
    else:
        card = card_of(path, bundle, licence)
        members = {CARD: _json(card), README: markdown(card).encode()}
        members |= {name: (files.path / name).read_bytes() for name in NAMES}
    manifest = {
        "format": FORMAT,
        "format_version": ARCHIVE_VERSION,
        "fastac_version": version("fastac"),
        "bundle_sha256": bundle.digest,
        "files": {name: _facts(members[name]) for name in sorted(members)},
    }
    members = {MANIFEST: _json(manifest)} | {name: members[name] for name in (CARD, README, *NAMES)}
    with write_atomically(output) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, content in members.items():
            # Stored: the arrays are compressed already, and so that no zlib's version shows in the bytes.
            member = zipfile.ZipInfo(name, BEGINNING)
            member.create_system, member.external_attr = 3, 0o644 << 16
            archive.writestr(member, content)
    return bundle.digest


def card_text(path: Path) -> str:
    """The card of a bundle: a single file's own, and of a folder the one that it would get.

    Characters that could steer a terminal are left out: the file may come from anywhere.
    """
    bundle = bundles.load_bundle(path)
    files = open_files(bundles.bundle_folder(path))
    if not isinstance(files, Archive):
        return markdown(card_of(path, bundle))
    text = files.members[README].decode("utf-8", errors="replace")
    return "".join(character for character in text if character == "\n" or character.isprintable())


def _card(files: Archive) -> dict:
    try:
        card = json.loads(files.members[CARD])
        markdown(card)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BundleError(f"{files.place(CARD)}: not understood: {' '.join(repr(error).split())}") from None
    return card


def _json(content: dict) -> bytes:
    return (json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n").encode()


def _facts(content: bytes) -> dict:
    return {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
