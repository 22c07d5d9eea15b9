"""The paper's tables from one scene: everything trained, measured and simulated, beside the paper's figures.

The build comes first, then the sections, each a step that is kept while it is up to date; and the page. A new
section is one more entry of `SECTIONS`.
"""

import json
from collections.abc import Callable
from pathlib import Path

from fastac import (
    grasp,
    paper_figures,
    reproduce_force,
    reproduce_geometry,
    reproduce_goals,
    reproduce_limits,
    reproduce_page,
    reproduce_stages,
    vibration,
)
from fastac.build import Build
from fastac.reproduce_section import Section, stamped_key
from fastac.workspace import Step, Workspace, write_json

SECTIONS = (
    Section(
        "geometry",
        "Surface gradients and depth",
        reproduce_geometry.run,
        reproduce_geometry.tables,
        ("fastac/reproduce_geometry.py", "fastac/training.py"),
        lacks=reproduce_geometry.lacks,
    ),
    Section(
        "forces",
        "Three-axis force",
        reproduce_force.run,
        reproduce_force.tables,
        ("fastac/reproduce_force.py", "fastac/force_ablation.py", "fastac/training.py"),
        lacks=reproduce_force.lacks,
    ),
    Section(
        "stages",
        "Stages: accuracy, latency, energy",
        reproduce_stages.run,
        reproduce_stages.tables,
        ("fastac/reproduce_stages.py", "fastac/rapl.py", "fastac/benchmark.py"),
        lacks=reproduce_stages.lacks,
        of_hardware=True,
    ),
    Section(
        "limits",
        "What limits it",
        reproduce_limits.run,
        reproduce_limits.tables,
        (
            "sensor/**/*.py",
            "fastac/reproduce_limits.py",
            "fastac/limits_*.py",
            "fastac/reproduce_geometry.py",
        ),
        needs=("geometry", "forces"),
        lacks=reproduce_limits.lacks,
    ),
    Section(
        "vibration",
        "In time: vibrations",
        lambda build, folder: vibration.run(build.bundle, folder, cache=build.cache, progress=build.progress),
        vibration.tables,
        ("sensor/**/*.py", "fastac/vibration.py", "fastac/sampling.py", "fastac/temporal_figures.py"),
        lacks=lambda build: vibration.lacks(build.scene),
    ),
    Section(
        "grasp",
        "In time: a bottle that slips",
        lambda build, folder: grasp.run(build.bundle, folder, cache=build.cache, progress=build.progress),
        grasp.tables,
        (
            *("sensor/**/*.py", "fastac/grasp.py", "fastac/bottle.py", "fastac/grip_control.py"),
            *("fastac/vibration.py", "fastac/temporal_figures.py"),
        ),
        lacks=lambda build: grasp.lacks(build.scene),
    ),
)
COMMON = ("models/**/*.py", "fastac/reproduce_section.py", "fastac/frames.py", "fastac/paper_figures.py")
RESULT, PAGE = "reproduce.json", "reproduce.html"


def steps(build: Build, folder: Path, present: list[Section]) -> list[Step]:
    """The sections of a finished build as steps in `folder`."""
    bundle, simulated = stamped_key(build, "bundle"), stamped_key(build, "sim")
    names = [section.name for section in present]

    def performed(section: Section) -> Callable[[], None]:
        def run() -> None:
            (folder / section.name).mkdir(parents=True, exist_ok=True)
            write_json(folder / section.file, section.run(build, folder / section.name))

        return run

    return [
        Step(
            section.name,
            performed(section),
            [bundle, *([simulated] if section.of_hardware else [])],
            (*COMMON, *section.sources),
            (section.file,),
            tuple(name for name in section.needs if name in names),
        )
        for section in present
    ]


def run(
    build: Build,
    folder: Path,
    announce: Callable[[str, bool], None],
    sections: tuple[Section, ...] = SECTIONS,
) -> dict:
    """Build, perform what is not up to date, write JSON and page into `folder`; returns what the JSON has."""
    build.run(announce)
    absent = {section.name: section.lacks(build) for section in sections}
    present = [section for section in sections if absent[section.name] is None]
    workspace = Workspace(folder)
    for step in steps(build, folder, present):
        workspace.perform(step, announce)
    found = {section.name: json.loads((folder / section.file).read_text()) for section in present}
    scene, data = build.scene, build.data
    content = {
        "scene": scene.model_dump(mode="json"),
        "bundle_sha256": build.bundle.digest,
        "frames_are": scene.sensor.source,
        "source": data.source,
        "samples": {split: len(data.indices(split)) for split in ("train", "validation", "test")},
        "goals": reproduce_goals.goals(found),
        "sections": found,
        "absent": {name: why for name, why in absent.items() if why is not None},
        "paper": {
            "gradient_mae_mm_per_px": paper_figures.GRADIENT_MAE_MM_PER_PX,
            "depth_mae_mm": paper_figures.DEPTH_MAE_MM,
            "force_mae_n": {" ".join(key): mae for key, mae in paper_figures.FORCE_MAE_N.items()},
            "force": paper_figures.FORCE_FULL,
            "stages": paper_figures.STAGES,
        },
    }
    write_json(folder / RESULT, content)
    reproduce_page.write(content, sections, folder, folder / PAGE)
    return content
