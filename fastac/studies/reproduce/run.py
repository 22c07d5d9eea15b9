"""The paper's tables from one scene: everything trained, measured and simulated, beside the paper's figures.

The build comes first, then the sections, each a step that is kept while it is up to date; and the page. A new
section is one more entry of `SECTIONS`.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from fastac.flow.build import Build
from fastac.flow.steps import BUNDLE, DATA, REPORT
from fastac.report import paper
from fastac.store.files import write_json
from fastac.store.kinds import Kinds
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.studies.demos import grasp, vibration
from fastac.studies.reproduce import force, geometry, goals, limits, page, stages
from fastac.studies.reproduce.section import Section

SECTIONS = Kinds(
    "section",
    {
        "geometry": Section(
            "Surface gradients and depth",
            geometry.run,
            geometry.tables,
            ("geometry.png",),
            lacks=geometry.lacks,
        ),
        "forces": Section(
            "Three-axis force",
            force.run,
            force.tables,
            ("force_ablation.png",),
            others=("force_ablation.json",),
            lacks=force.lacks,
        ),
        "stages": Section(
            "Stages: accuracy, latency, energy",
            stages.run,
            stages.tables,
            ("stages.png",),
            reads=("scene", "bundle", "data", "report"),
            lacks=stages.lacks,
        ),
        "limits": Section(
            "What limits it",
            limits.run,
            limits.tables,
            ("limits.png",),
            needs=("geometry",),
            lacks=limits.lacks,
        ),
        "vibration": Section(
            "In time: vibrations",
            vibration.section,
            vibration.tables,
            ("vibration.png",),
            reads=("scene", "bundle"),
            lacks=lambda build: vibration.lacks(build.scene),
        ),
        "grasp": Section(
            "In time: a bottle that slips",
            grasp.section,
            grasp.tables,
            ("grasp.png",),
            reads=("scene", "bundle"),
            lacks=lambda build: grasp.lacks(build.scene),
        ),
    },
)
"""By name, which is also that of the section's folder."""
RESULT, PAGE = "reproduce.json", "reproduce.html"


def steps(build: Build, sections: Mapping[str, Section]) -> dict[str, Step]:
    """The sections of a build as steps, by name."""
    results = {
        "scene": build.scene,
        "bundle": build.steps["bundle"].output(BUNDLE),
        "data": build.data_file or build.steps["data"].output(DATA),
        "report": build.steps["report"].output(REPORT),
    }
    unkeyed = {"store": build.store, "progress": build.progress}
    found: dict[str, Step] = {}
    for name, section in sections.items():
        arguments = {read: results[read] for read in section.reads}
        arguments |= {needed: found[needed].output(f"{needed}.json") for needed in section.needs}
        outputs = (f"{name}.json", *section.pictures, *section.others)
        found[name] = Step(name, section.run, arguments, outputs, unkeyed)
    return found


def run(
    build: Build,
    folder: Path,
    announce: Callable[[str, str], None],
    sections: Mapping[str, Section] = SECTIONS,
) -> dict:
    """Build, perform what is not up to date, write JSON and page into `folder`; returns what the JSON has."""
    build.run(announce)
    store, performed = open_store(build.store), {}
    for step in build.steps.values():
        store.perform(step, None, performed)
    absent = {name: section.lacks(build) for name, section in sections.items()}
    present = {name: section for name, section in sections.items() if absent[name] is None}
    found = {}
    for name, step in steps(build, present).items():
        entry = store.perform(step, announce, performed)
        (folder / name).mkdir(parents=True, exist_ok=True)
        found[name] = json.loads(entry.place(folder / name)[f"{name}.json"].read_text())
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
