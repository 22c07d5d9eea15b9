"""Results of verification campaigns: one file each, from which the page docs/verification.md is made."""

import ast
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from fastac.store.digest import path_digest
from fastac.store.files import DamagedFileError, content_hash, read_json, write_json
from fastac.store.references import parsed

FOLDER = Path("build/evidence")
GATEWARE = Path(__file__).resolve().parents[1] / "gateware"
PACKAGE = "fastac.gateware"


@dataclass(frozen=True)
class Table:
    """A table of a campaign's results; cells are text or numbers, and None where nothing was obtained."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""


@dataclass(frozen=True)
class Evidence:
    """What a campaign has shown.

    name : its file in `FOLDER`, for example "formal"
    title, summary : heading, and the result in a sentence or two, with its numbers
    command : what prints the same again, for example "make formal"
    seconds : wall time of the campaign on the machine that ran it
    not_covered : sentences, each on something that the campaign does not show
    gateware : digest of the hardware's sources that it ran on
    """

    name: str
    title: str
    command: str
    summary: str
    seconds: float
    tables: Sequence[Table]
    not_covered: Sequence[str] = ()
    gateware: str = field(default_factory=lambda: gateware_digest())


def gateware_digest(folder: Path = GATEWARE) -> str:
    """Digest of the hardware's sources: `top_zynq.py` in the folder `gateware/`, and what it imports there.

    What only describes the hardware, such as the formulas of cycles or the table of devices, does not count.
    """
    found, waiting = {}, ["top_zynq"]
    while waiting:
        name = waiting.pop()
        path = folder / f"{name.replace('.', '/')}.py"
        if name in found or not path.is_file():
            continue
        found[name] = path_digest(path)
        for node in ast.walk(parsed(path.read_bytes())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
                below = node.module.removeprefix(PACKAGE).removeprefix(".")
                waiting += [below, *(f"{below}.{alias.name}".strip(".") for alias in node.names)]
    return content_hash(sorted(found.items()))[:16]


def keep(evidence: Evidence, folder: Path = FOLDER) -> Path:
    """Write `evidence` to `folder`, in place of the campaign's earlier result; returns the file."""
    path = folder / f"{evidence.name}.json"
    write_json(path, asdict(evidence))
    return path


def load(path: Path) -> Evidence:
    """Raises DamagedFileError for a file that holds no evidence, or that of a campaign of another name."""
    content = read_json(path)
    try:
        evidence = TypeAdapter(Evidence).validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise DamagedFileError(f"{path}: no results of a campaign ({key}: {first['msg']})") from None
    if evidence.name != path.stem:
        raise DamagedFileError(f"{path}: name = {evidence.name!r}: expected {path.stem!r}, as the file's")
    return evidence
