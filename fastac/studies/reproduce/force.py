"""Section "forces": the ablation of HyperForce, and the accuracy of every component of the force."""

from pathlib import Path

from fastac.models import accuracy
from fastac.models.floating.pipeline import FloatPipeline
from fastac.report.paper import FORCE_FULL, FORCE_MAE_N
from fastac.report.tables import Table
from fastac.scenes.schema import AXES, Scene
from fastac.sensor.dataset import DatasetError
from fastac.store.files import write_json
from fastac.studies.reproduce import force_ablation
from fastac.studies.reproduce.section import Finished, Known, beside

FULL = "dynamic xyz"
MEASURES = {
    "mae_n": "MAE, N",
    "rmse_n": "RMSE, N",
    "nmae_percent": "NMAE, %",
    "nrmse_percent": "NRMSE, %",
    "r2": "R²",
}


def lacks(build: Known) -> str | None:
    """One line that says why this section cannot be run on the build; None if it can."""
    if not build.scene.wants_force:
        return f"outputs = {', '.join(build.scene.outputs)}: no force is wanted"
    if build.scene.sensor.markers is None:
        return "sensor.markers: missing, so nothing shows d_x and d_y"
    try:
        force_ablation.require(build.data, build.scene, build.data_path, True)
    except DatasetError as error:
        return str(error)
    return None


def run(folder: Path, scene: Scene, bundle: Path, data: Path, *, store: Path, progress: bool) -> None:
    """Run the ablation on the build's dataset and pixel network; add the errors of the build's own force
    model, which uses d_z alone."""
    build = Finished.read(scene, bundle, data, store=store, progress=progress)
    kinds = ("true", "found")
    content = force_ablation.compare(
        build.scene, data, kinds, folder, bundle=bundle, store=store, progress=progress
    )
    write_json(folder / force_ablation.RESULT, content)
    index, axes = build.data.indices("test"), build.scene.force_axes
    truth_n = build.data.forces_n(index, axes)
    pipelines = {"float": FloatPipeline.from_bundle(build.bundle), "integer": build.bundle.pipeline}
    own = {}
    for name, pipeline in pipelines.items():
        model = accuracy.with_background_of(pipeline, build.data)
        found_n = model.run(build.data.frames[index], wanted=("force_n",), progress=progress).force_n
        own[name] = force_ablation.errors(found_n, truth_n)
    write_json(folder / "forces.json", {**content, "build": {"axes": [AXES[axis] for axis in axes], **own}})


def tables(content: dict) -> list[Table]:
    """An ablation table per kind of displacement, and the accuracy of all models by axis."""
    found = [_ablation(name, known["results"]) for name, known in content["displacements"].items()]
    return [*found, _accuracy(content)]


def _ablation(name: str, results: dict) -> Table:
    rows = [
        [kernel, "+".join(f"d_{axis}" for axis in inputs)]
        + [
            cell
            for ours, paper in zip(results[f"{kernel} {inputs}"]["mae_n"], theirs, strict=True)
            for cell in beside(ours, paper)
        ]
        for (kernel, inputs), theirs in FORCE_MAE_N.items()
    ]
    head = [f"F_{axis}, {whose}" for axis in AXES for whose in ("ours", "paper")]
    note = {
        "true": "On true displacements: the limit of the model itself.",
        "found": "On displacements from the frames: d_z by network and solver, d_x and d_y by the markers.",
    }
    return Table(
        f"HyperForce on {name} displacements: MAE, N", ["kernel", "input", *head], rows, note.get(name, "")
    )


def _accuracy(content: dict) -> Table:
    own = content["build"]
    models = {
        f"HyperForce, {name} displacements": (known["results"][FULL], AXES)
        for name, known in content["displacements"].items()
    }
    models |= {f"the build's force, {name}": (own[name], own["axes"]) for name in ("float", "integer")}
    paper = {"mae_n": FORCE_MAE_N["dynamic", "xyz"], **FORCE_FULL}
    rows = []
    for key, label in MEASURES.items():
        for model, (errors, axes) in models.items():
            known = dict(zip(axes, errors[key], strict=True))
            rows.append([label, model, *(f"{known[a]:.4f}" if a in known else "" for a in AXES)])
        if key in paper:
            rows.append([label, "the paper", *(f"{value:.4f}" for value in paper[key])])
    return Table(
        "Accuracy of the three-axis force",
        ["measure", "model", *(f"F_{axis}" for axis in AXES)],
        rows,
        "Normalised by each component's largest true load. The build's force is what the hardware computes: a"
        " linear map of d_z alone, without markers.",
    )
