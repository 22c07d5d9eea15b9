"""JSON files that appear whole or not at all, and hashes of content."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path


def digest_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_hash(*content) -> str:
    """Of JSON; short enough for a file's name."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


def write_json(path: Path, content) -> None:
    """Write JSON so that the file is never half there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_text(json.dumps(content, indent=1) + "\n")
    os.replace(temporary, path)


def read_or_make(path: Path, make: Callable[[], object]):
    """The JSON in a file, made and written first where there is none."""
    if not path.exists():
        write_json(path, make())
    return json.loads(path.read_text())
