"""The page docs/verification.md: what has been shown of the hardware, campaign by campaign."""

from collections.abc import Sequence
from pathlib import Path

from fastac.store.evidence import Evidence, Table, gateware_digest, keep, load

CAMPAIGNS = ("formal", "mutation", "simulators", "faults", "fuzz")
"""In the order of the page."""
HEAD = """\
# Verification

What has been shown of the hardware and of the readers, by which means, and what has not. `fastac prove page`
writes this page from the results that the commands below leave in `build/evidence/`, and keeps them in
`docs/evidence/`; a campaign that has not been run again keeps its last result. Times are wall times on two
cores, mostly beside other work. Nothing here was run on a board.
"""


def _rows(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table without padding: a page of long cells stays readable as text."""
    cells = [["" if cell is None else str(cell).replace("|", "\\|") for cell in row] for row in rows]
    lines = [list(columns), ["---"] * len(columns), *cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _table(table: Table) -> str:
    return "\n\n".join(filter(None, (f"### {table.title}", table.note, _rows(table.columns, table.rows))))


def _section(evidence: Evidence, gateware: str) -> str:
    minutes = f"{evidence.seconds / 60:.1f} min"
    parts = [f"## {evidence.title}", f"`{evidence.command}` ({minutes}). {evidence.summary}"]
    if evidence.gateware != gateware:
        parts.append("These results are of an earlier state of `gateware/`.")
    parts += [_table(table) for table in evidence.tables]
    if evidence.not_covered:
        parts.append("Not covered:\n\n" + "\n".join(f"- {sentence}" for sentence in evidence.not_covered))
    return "\n\n".join(parts)


def page(found: Sequence[Evidence], gateware: str) -> str:
    """The page's text, in Markdown; campaigns without a result are named as such.

    gateware : digest of the present sources; results of others say that they are older
    """
    by_name = {evidence.name: evidence for evidence in found}
    overview = _rows(
        ("campaign", "command", "time"),
        [
            (by_name[name].title, f"`{by_name[name].command}`", f"{by_name[name].seconds / 60:.1f} min")
            for name in CAMPAIGNS
            if name in by_name
        ],
    )
    missing = [name for name in CAMPAIGNS if name not in by_name]
    parts = [HEAD.rstrip(), overview]
    if missing:
        parts.append(f"No results here of: {', '.join(missing)}.")
    parts += [_section(by_name[name], gateware) for name in CAMPAIGNS if name in by_name]
    return "\n\n".join(parts) + "\n"


def of_folders(new: Path, kept: Path) -> str:
    """The page of the results in `new`, and for campaigns without one there, in `kept`.

    The new results are copied to `kept`. Raises FileNotFoundError if neither holds any.
    """
    found = []
    for name in CAMPAIGNS:
        paths = [folder / f"{name}.json" for folder in (new, kept)]
        path = next((path for path in paths if path.exists()), None)
        if path is not None:
            found.append(load(path))
    for evidence in found:
        keep(evidence, kept)
    if not found:
        raise FileNotFoundError(f"{new}: no results of a campaign; run make formal, for example")
    return page(found, gateware_digest())
