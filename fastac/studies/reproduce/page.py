"""The reproduction as a page and as text: each section's tables and pictures, the goals first."""

import base64
from collections.abc import Sequence
from pathlib import Path

import jinja2

from fastac.report.tables import Table
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
                (picture.stem, base64.b64encode(picture.read_bytes()).decode())
                for picture in sorted((folder / section.name).glob("*.png"))
            ]
        why = content["absent"].get(section.name)
        shown.append((section.title, why, found.get(section.name, []), pictures))
    template = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__, "."), autoescape=True, undefined=jinja2.StrictUndefined
    ).get_template("page.html.j2")
    goals = reproduce_goals.table(content["goals"]) if content["goals"] else None
    page = template.render(content=content, whose=whose(content), goals=goals, sections=shown)
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_text(page, encoding="utf-8")
    temporary.replace(path)
