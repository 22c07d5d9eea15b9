"""The paper's tables from one scene: everything trained, measured and simulated, beside the paper's figures.

The build comes first, then the sections, each a step that is kept while it is up to date; and the page. A new
section is one more entry of `SECTIONS`.
"""

import json
from collections.abc import Callable
from pathlib import Path

from fastac.flow.build import Build
from fastac.report import paper
from fastac.store.files import write_json
from fastac.store.workspace import Step, Workspace
from fastac.studies.demos import grasp, vibration
from fastac.studies.reproduce import force, geometry, goals, limits, page, stages
from fastac.studies.reproduce.section import Section, stamped_key

SECTIONS = (
    Section(
        "geometry",
        "Surface gradients and depth",
        geometry.run,
        geometry.tables,
        ("fastac/studies/reproduce/geometry.py", "fastac/flow/training.py"),
        lacks=geometry.lacks,
    ),
    Section(
        "forces",
        "Three-axis force",
        force.run,
        force.tables,
        (
            "fastac/studies/reproduce/force.py",
            "fastac/studies/reproduce/force_ablation.py",
            "fastac/flow/training.py",
        ),
        lacks=force.lacks,
    ),
    Section(
        "stages",
        "Stages: accuracy, latency, energy",
        stages.run,
        stages.tables,
        (
            "fastac/studies/reproduce/stages.py",
            "fastac/studies/benchmarks/rapl.py",
            "fastac/studies/benchmarks/models.py",
        ),
        lacks=stages.lacks,
        of_hardware=True,
    ),
    Section(
        "limits",
        "What limits it",
        limits.run,
        limits.tables,
        (
            "sensor/**/*.py",
            "fastac/studies/reproduce/limits.py",
            "fastac/studies/reproduce/limits_*.py",
            "fastac/studies/reproduce/geometry.py",
        ),
        needs=("geometry", "forces"),
        lacks=limits.lacks,
    ),
    Section(
        "vibration",
        "In time: vibrations",
        lambda build, folder: vibration.run(build.bundle, folder, store=build.store, progress=build.progress),
        vibration.tables,
        (
            "sensor/**/*.py",
            "fastac/studies/demos/vibration.py",
            "fastac/studies/demos/sampling.py",
            "fastac/studies/demos/time_figures.py",
        ),
        lacks=lambda build: vibration.lacks(build.scene),
    ),
    Section(
        "grasp",
        "In time: a bottle that slips",
        lambda build, folder: grasp.run(build.bundle, folder, store=build.store, progress=build.progress),
        grasp.tables,
        (
            *(
                "sensor/**/*.py",
                "fastac/studies/demos/grasp.py",
                "fastac/studies/demos/bottle.py",
                "fastac/studies/demos/grip_control.py",
            ),
            *("fastac/studies/demos/vibration.py", "fastac/studies/demos/time_figures.py"),
        ),
        lacks=lambda build: grasp.lacks(build.scene),
    ),
)
COMMON = (
    "models/**/*.py",
    "fastac/studies/reproduce/section.py",
    "fastac/flow/frames.py",
    "fastac/report/paper.py",
)
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
        "goals": goals.goals(found),
        "sections": found,
        "absent": {name: why for name, why in absent.items() if why is not None},
        "paper": {
            "gradient_mae_mm_per_px": paper.GRADIENT_MAE_MM_PER_PX,
            "depth_mae_mm": paper.DEPTH_MAE_MM,
            "force_mae_n": {" ".join(key): mae for key, mae in paper.FORCE_MAE_N.items()},
            "force": paper.FORCE_FULL,
            "stages": paper.STAGES,
        },
    }
    write_json(folder / RESULT, content)
    page.write(content, sections, folder, folder / PAGE)
    return content
