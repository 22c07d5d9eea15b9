"""The reproduction as an HTML page and as text: each section's tables and figures, and the goals."""

import base64
from collections.abc import Sequence
from pathlib import Path

import jinja2

from fastac.report.tables import Table
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
                (picture.stem, base64.b64encode(picture.read_bytes()).decode())
                for picture in sorted((folder / section.name).glob("*.png"))
            ]
        why = content["absent"].get(section.name)
        shown.append((section.title, why, found.get(section.name, []), pictures))
    template = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__, "."), autoescape=True, undefined=jinja2.StrictUndefined
    ).get_template("page.html.j2")
    goals = reproduce_goals.table(content["goals"]) if content["goals"] else None
    page = template.render(content=content, whose=provenance(content), goals=goals, sections=shown)
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_text(page, encoding="utf-8")
    temporary.replace(path)
