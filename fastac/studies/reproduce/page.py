"""The reproduction as an HTML page and as text: each section's tables and figures, and the goals."""

from collections.abc import Sequence
from pathlib import Path

from fastac.report.figures import base64_png
from fastac.report.render import render
from fastac.report.tables import Table
from fastac.store.files import write_text
from fastac.studies.reproduce import goals as reproduce_goals
from fastac.studies.reproduce.section import Section


def provenance(content: dict) -> str:
    """One line that says where our figures and the paper's come from."""
    samples = ", ".join(f"{count} {split}" for split, count in content["samples"].items())
    return (
        f"Ours: scene {content['scene']['name']}, {content['frames_are']} frames ({content['source']};"
        f" {samples}): all our errors are on these. The paper's: its own sensor and board."
    )


def tables(content: dict, sections: Sequence[Section]) -> dict[str, list[Table]]:
    """The tables of each section that was run, by its name."""
    present = [section for section in sections if section.name in content["sections"]]
    return {section.name: section.tables(content["sections"][section.name]) for section in present}


def text(content: dict, sections: Sequence[Section]) -> str:
    """All tables as plain text, the goals last."""
    parts = [provenance(content)]
    found = tables(content, sections)
    for section in sections:
        parts.append(f"== {section.title}; ours: {content['frames_are']} frames ==")
        if section.name in content["absent"]:
            parts.append(f"absent: {content['absent'][section.name]}")
        parts += ["\n".join(part for part in (t.text, t.note) if part) for t in found.get(section.name, [])]
    if content["goals"]:
        parts.append(reproduce_goals.table(content["goals"]).text)
    return "\n\n".join(parts)


def write(content: dict, sections: Sequence[Section], folder: Path, path: Path) -> None:
    """Write the page with its figures embedded to `path`; `folder` holds the sections' folders."""
    found, shown = tables(content, sections), []
    for section in sections:
        pictures = []
        if section.name in found:
            pictures = [
                (picture.stem, base64_png(picture))
                for picture in sorted((folder / section.name).glob("*.png"))
            ]
        why = content["absent"].get(section.name)
        shown.append((section.title, why, found.get(section.name, []), pictures))
    goals = reproduce_goals.table(content["goals"]) if content["goals"] else None
    page = render(
        "studies/reproduce/reproduction.html.j2",
        content=content,
        whose=provenance(content),
        goals=goals,
        sections=shown,
    )
    write_text(path, page)
