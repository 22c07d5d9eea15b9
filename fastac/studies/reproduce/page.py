"""The reproduction as an HTML page and as text: each section's tables and figures, and the goals."""

from collections.abc import Mapping
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


def tables(content: dict, sections: Mapping[str, Section]) -> dict[str, list[Table]]:
    """The tables of each section that was run, by its name."""
    return {name: sections[name].tables(found) for name, found in content["sections"].items()}


def text(content: dict, sections: Mapping[str, Section]) -> str:
    """All tables as plain text, the goals last."""
    parts = [provenance(content)]
    found = tables(content, sections)
    for name, section in sections.items():
        parts.append(f"== {section.title}; ours: {content['frames_are']} frames ==")
        if name in content["absent"]:
            parts.append(f"absent: {content['absent'][name]}")
        parts += ["\n".join(part for part in (t.text, t.note) if part) for t in found.get(name, [])]
    if content["goals"]:
        parts.append(reproduce_goals.table(content["goals"]).text)
    return "\n\n".join(parts)


def write(content: dict, sections: Mapping[str, Section], folder: Path, path: Path) -> None:
    """Write the page with its figures embedded to `path`; `folder` holds the sections' folders."""
    found, shown = tables(content, sections), []
    for name, section in sections.items():
        files = [folder / name / picture for picture in section.pictures if name in found]
        pictures = [(file.stem, base64_png(file)) for file in files]
        shown.append((section.title, content["absent"].get(name), found.get(name, []), pictures))
    goals = reproduce_goals.table(content["goals"]) if content["goals"] else None
    page = render(
        "studies/reproduce/reproduction.html.j2",
        content=content,
        whose=provenance(content),
        goals=goals,
        headlines=reproduce_goals.headlines(content["goals"]),
        sections=shown,
    )
    write_text(path, page)
