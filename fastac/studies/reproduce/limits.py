"""Section "limits": experiments that remove one source of error each, to find what limits the accuracy."""

import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from fastac.report.figures import save_png
from fastac.report.tables import Table, number
from fastac.scenes.schema import AXES, Scene
from fastac.store.files import write_json
from fastac.studies.reproduce import force, geometry, limits_force, limits_geometry
from fastac.studies.reproduce.geometry import NAMES
from fastac.studies.reproduce.section import Finished, Known


def lacks(build: Known) -> str | None:
    """One line that says why this section cannot be run on the build; None if it can."""
    data = build.data
    if build.scene.sensor.source != "simulated" or not data.source.startswith("simulated"):
        return "the frames are recorded: no source of error can be removed"
    if data.valid is not None and not data.valid.all():
        return "the geometry is known on part of the skin only, so frames cannot be rendered again"
    return geometry.lacks(build)


def run(
    folder: Path, scene: Scene, bundle: Path, data: Path, geometry: Path, *, store: Path, progress: bool
) -> None:
    """Run the experiments, those in a step of their own that train; `geometry` is that section's JSON."""
    # Before this process reads the frames: each training has them in memory too.
    networks = limits_geometry.networks(scene, data, store=store, progress=progress)
    build = Finished.read(scene, bundle, data, store=store, progress=progress)
    judged = json.loads(geometry.read_text())["channels"]
    content = {
        "build": {channels: limits_geometry.summary(errors) for channels, errors in judged.items()},
        "networks": networks,
        "regions": limits_geometry.regions(build),
        "solver_depth_mae_mm": limits_geometry.solver(build),
    }
    if force.lacks(build) is None:
        content["force"] = limits_force.experiments(build)
    draw(content, folder / "limits.png")
    write_json(folder / "limits.json", content)


def tables(content: dict) -> list[Table]:
    """Gradients and depth by experiment, errors by region, the solver alone, and forces by experiment."""
    rows = []
    networks = {"as recorded, the build's networks": content["build"], **content["networks"]}
    for name, found in networks.items():
        gradient, depth = (
            [found[channels][key] if channels in found else None for channels in NAMES]
            for key in ("gradient_mae_mm_per_px", "depth_mae_mm")
        )
        reduction = "" if gradient[0] is None else f"{100 * (1 - gradient[1] / gradient[0]):.1f}"
        cells = [["" if value is None else number(value) for value in pair] for pair in (gradient, depth)]
        rows.append([name, *cells[0], reduction, *cells[1]])
    head = [f"gradient, {name}" for name in NAMES.values()]
    head = ["frames", *head, "reduction %", *(f"depth, {name}" for name in NAMES.values())]
    found = [
        Table(
            "Light, skin and camera: gradient MAE in mm/px and depth MAE with prior in mm",
            head,
            rows,
            "The build's networks learn from all presses; those below, each for the frames as one sensor"
            " sees them, from the vertical ones alone: compare these with the second line.",
        ),
        Table(
            "Where the gradient errors are",
            ["pixels", "% of all", "MAE, mm/px", "% of the error"],
            [[name, *map(number, part.values())] for name, part in content["regions"].items()],
            "The build's own float pipeline, vertical presses of the test grid.",
        ),
        Table(
            "The Poisson solver alone, from true normals",
            ["what is solved for", "depth MAE, mm"],
            [[mode, number(mae)] for mode, mae in content["solver_depth_mae_mm"].items()],
        ),
    ]
    if "force" in content:
        rows = [
            [
                name,
                *(f"{value:.4f}" for value in errors["mae_n"]),
                *(f"{value:.2f}" for value in errors["nmae_percent"]),
            ]
            for name, errors in content["force"].items()
        ]
        head = [f"F_{axis}, MAE N" for axis in AXES] + [f"F_{axis}, NMAE %" for axis in AXES]
        note = (
            "Dynamic kernel, all three inputs, in closed form. NMAE by the largest load of the test frames."
        )
        found.append(Table("Displacements and loads", ["experiment", *head], rows, note))
    return found


def draw(content: dict, path: Path) -> None:
    """Write a PNG with the experiments' errors as bars."""
    panels = [("gradient MAE, mm/px", content["networks"], NAMES, "gradient_mae_mm_per_px")]
    panels.append(("depth MAE, mm", content["networks"], NAMES, "depth_mae_mm"))
    figure, axes = plt.subplots(1, 3 if "force" in content else 2, figsize=(15, 3.8), squeeze=False)
    for axis, (label, found, names, key) in zip(axes[0], panels, strict=False):
        at = np.arange(len(found))
        for k, (channels, title) in enumerate(names.items()):
            here = [n for n, errors in enumerate(found.values()) if channels in errors]
            heights = [errors[channels][key] for errors in found.values() if channels in errors]
            axis.barh(at[here] + (k - 0.5) * 0.4, heights, 0.38, label=title)
        _finish(axis, found, label)
    if "force" in content:
        axis, at = axes[0, 2], np.arange(len(content["force"]))
        for k, name in enumerate(AXES):
            heights = [errors["nmae_percent"][k] for errors in content["force"].values()]
            axis.barh(at + (k - 1) * 0.27, heights, 0.25, label=f"F_{name}")
        _finish(axis, content["force"], "force, NMAE %")
    figure.tight_layout()
    save_png(figure, path)


def _finish(axis, names, label: str) -> None:
    axis.set_yticks(range(len(names)), names, fontsize=7)
    axis.set_xlabel(label)
    axis.invert_yaxis()
    axis.legend(fontsize=7, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1))
