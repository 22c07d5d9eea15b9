"""The record in a build folder: of each step the store's entry that the folder's files are of."""

import json
from pathlib import Path

from fastac.store.entries import Entry

RECORD = "steps.json"
"""In a build folder: of each step the store's entry that the folder's files are of, and how long it took."""


def described(entry: Entry) -> dict:
    return {"entry": entry.id, "seconds": entry.seconds, "performed": entry.trace["performed"]}


def read_record(folder: Path) -> dict[str, dict]:
    """What the last build says of its steps; nothing where none has run in this folder.

    Steps whose part of the record is damaged are left out, as if they had not run.
    """
    try:
        found = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict):
        return {}
    return {
        name: step
        for name, step in found.items()
        if isinstance(step, dict) and isinstance(step.get("seconds"), float | int)
    }
