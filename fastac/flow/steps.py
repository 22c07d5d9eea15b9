"""What the steps of a build do: each reads what the steps before it wrote and writes into a folder.

`flow/build.py` says which step is given what. A function here takes the folder to write into first; `store`
is the folder of the step store, for what a step has kept on its own, such as processed frames.
"""

import shutil
from pathlib import Path

import numpy as np

from fastac.flow import force_training, frames, hardware, left_out_groups, training
from fastac.models import accuracy, interval_accuracy
from fastac.models.integer import bundle as bundles
from fastac.models.integer.force_interval import INTERVAL
from fastac.report import page
from fastac.scenes.schema import Scene
from fastac.sensor import fingertip, samples
from fastac.sensor.dataset import Dataset
from fastac.store.files import save_arrays, write_json
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.synth import synthesis, vivado_reports

DATA = "data.h5"
NORMALS, INTEGERS, FORCE, LEFT_OUT = "normals.npz", "integers.npz", "force.npz", "left_out.npz"
BUNDLE, ACCURACY, VERILOG, SIMULATION = "bundle", "accuracy.json", "verilog", "sim.json"
REPORT, PAGE = "report.json", "report.html"


def data(folder: Path, scene: Scene, *, store: Path, progress: bool) -> None:
    """Press the virtual fingertip after the scene's protocol."""
    fingertip.generate(scene, folder / DATA, store=store, progress=progress)


def virtual_presses(scene: Scene, store: Path, *, progress: bool) -> Path:
    """The file of the scene's virtual presses, made if need be: for studies, by the step of a build."""
    arguments = {"store": store, "progress": progress}
    return open_store(store).perform(Step("data", data, {"scene": scene}, (DATA,), arguments)).path(DATA)


def training_data(path: Path, scene: Scene, store: Path, *, progress: bool = False) -> Dataset:
    """The dataset; raises TrainingError where it lacks what the scene is trained on.

    What that check reads of the scene is not recorded: it changes no result, and every step makes it.
    """
    data = frames.read(path, scene, store=store, progress=progress)
    training.require(data, scene.unwatched(), path)
    return data


def normals(folder: Path, scene: Scene, data: Path, *, store: Path, progress: bool) -> None:
    """Train the float pixel network; raises TrainingError where the data lack what the scene wants.

    Before it is trained on for depth or force it is kept: an interruption there, or another setting of that
    training, begins from it.
    """
    given, unkeyed = {"scene": scene, "data": data}, {"store": store, "progress": progress}
    if not scene.training.learns_sums:
        pixel_network(folder, **given, **unkeyed)
        return
    step = Step("pixel_network", pixel_network, given, (NORMALS,), unkeyed)
    weights = open_store(store).perform(step).path(NORMALS)
    known = training_data(data, scene, store, progress=progress)
    training.on_sums(known, scene, weights, folder / NORMALS, progress=progress)


def pixel_network(folder: Path, scene: Scene, data: Path, *, store: Path, progress: bool) -> None:
    """Train the float pixel network on normals, or on forces alone, and on nothing that sums its slopes."""
    known = training_data(data, scene, store, progress=progress)
    training.pixel_network(known, scene, folder / NORMALS, progress=progress)


def integers(folder: Path, scene: Scene, data: Path, weights: Path, *, store: Path, progress: bool) -> None:
    """Quantise the pixel network and fine-tune it with the integer arithmetic as its forward pass."""
    known = training_data(data, scene, store, progress=progress)
    training.integers(known, scene, weights, folder / INTEGERS, progress=progress)


def force(
    folder: Path, scene: Scene, data: Path, weights: Path, integers: Path, *, store: Path, progress: bool
) -> None:
    """Train the force model, then fit its last layer to each pipeline."""
    known = training_data(data, scene, store, progress=progress)
    force_training.force(known, scene, weights, integers, folder / FORCE, progress=progress)


def bundle(
    folder: Path,
    scene: Scene,
    data: Path,
    weights: Path,
    integers: Path,
    force: Path | None,
    left_out: Path | None = None,
    *,
    store: Path,
    progress: bool,
) -> None:
    """All integers and the float weights as a bundle."""
    known = training_data(data, scene, store, progress=progress)
    arrays = [training.load_arrays(path) if path else {} for path in (weights, integers, force)]
    scores = training.load_arrays(left_out) if left_out else {}
    found = (scores["scores"], scores["group"]) if scores else None
    training.assemble(known, scene, *arrays, folder / BUNDLE, found)


def left_out(folder: Path, scene: Scene, data: Path, *, store: Path, progress: bool) -> None:
    """Scores of each training group by models that did not know it, where intervals need them."""
    known = training_data(data, scene, store, progress=progress)
    found = left_out_groups.scores(known, scene, data, store, progress=progress)
    save_arrays(
        folder / LEFT_OUT, {} if found is None else dict(zip(("scores", "group"), found, strict=True))
    )


def evaluate(folder: Path, scene: Scene, bundle: Path, data: Path, *, store: Path, progress: bool) -> None:
    """Errors of the float and the integer model on the test split."""
    model = bundles.load_for(bundle, scene)
    known = frames.read(data, scene, store=store, progress=progress)
    index = samples.split_indices(known, "test", data)
    errors, _ = accuracy.compare_pipelines(model, known, index, progress=progress)
    if model.pipeline.interval is not None:
        errors[INTERVAL] = interval_accuracy.evaluate(model.pipeline, known, index, progress=progress)
    write_json(folder / ACCURACY, {"split": "test", "frames": len(index), **errors})


def verilog(folder: Path, scene: Scene, bundle: Path, *, progress: bool) -> None:
    hardware.write_verilog(bundles.load_for(bundle, scene), folder / VERILOG, progress=progress)


def simulate(
    folder: Path,
    scene: Scene,
    bundle: Path,
    verilog: Path,
    data: Path,
    count: int,
    *,
    workplace: Path,
    store: Path,
    progress: bool,
) -> None:
    """`count` held-out frames through the Verilog, every value compared with the integer model.

    workplace : where simulator and logs are and stay
    """
    model = bundles.load_for(bundle, scene)
    known = frames.read(data, scene, store=store, progress=progress)
    index = samples.evenly_spaced(known.indices("test"), count)
    found = hardware.simulate(model, known, index, verilog, workplace, progress=progress)
    write_json(folder / SIMULATION, {"frame_indices": np.asarray(index).tolist(), **found})


def report(
    folder: Path,
    scene: Scene,
    bundle: Path,
    data: Path,
    accuracy: Path,
    verilog: Path,
    simulation: Path,
    synthesis_file: Path | None,
    vivado_file: Path | None,
    *,
    store: Path,
) -> None:
    """report.json and report.html of what the steps before have written."""
    for source, name in (
        (accuracy, ACCURACY),
        (simulation, SIMULATION),
        (synthesis_file, synthesis.FILE),
        (vivado_file, vivado_reports.FILE),
    ):
        if source is not None:
            shutil.copyfile(source, folder / name)
    (folder / VERILOG).mkdir()
    shutil.copyfile(verilog / "hardware.json", folder / VERILOG / "hardware.json")
    model = bundles.load_for(bundle, scene)
    page.write(folder, model, frames.read(data, scene, store=store))
