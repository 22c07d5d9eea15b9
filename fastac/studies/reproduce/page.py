"""The reproduction as a page and as text: each section's tables and pictures, the goals first."""

from collections.abc import Sequence
from pathlib import Path

from fastac.report.figures import base64_png
from fastac.report.render import render
from fastac.report.tables import Table
from fastac.store.files import write_text
from fastac.studies.reproduce import goals as reproduce_goals
from fastac.studies.reproduce.section import Section


def whose(content: dict) -> str:
    """Where both columns' figures are from, in one line."""
    samples = ", ".join(f"{count} {split}" for split, count in content["samples"].items())
    return (
        f"Ours: scene {content['scene']['name']}, {content['frames_are']} frames ({content['source']};"
        f" {samples}): all errors of ours are of these. The paper's: its own sensor and board."
    )


def tables(content: dict, sections: Sequence[Section]) -> dict[str, list[Table]]:
    """By the name of each section that there is."""
    present = [section for section in sections if section.name in content["sections"]]
    return {section.name: section.tables(content["sections"][section.name]) for section in present}


def text(content: dict, sections: Sequence[Section]) -> str:
    """For a terminal: all tables, the goals last."""
    parts = [whose(content)]
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
    """The page, pictures and all in one file; the sections' folders are in `folder`."""
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
        whose=whose(content),
        goals=goals,
        sections=shown,
    )
    write_text(path, page)
