"""The ablation on drawn frames: the tables of a small dataset, resumed, and what it refuses."""

import json
import re
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.flow import training
from fastac.models.floating import displacement_3d
from fastac.models.training.force import hyperforce_3d
from fastac.report.paper import FORCE_MAE_N
from fastac.scenes import schema
from fastac.sensor import dataset
from fastac.sensor.dataset import DatasetError
from fastac.store.store import open_store
from fastac.studies.reproduce import force_ablation
from fastac.studies.reproduce.displacements import FILE, true_step
from fastac.studies.reproduce.force_ablation import errors, require

SIZE, PITCH = 32, 0.25
TEXT = f"""
name = "drawn"
outputs = ["depth", "force_xyz"]
[sensor]
geometry = "flat"
height_px = {SIZE}
width_px = {SIZE}
pitch_mm = {PITCH}
[sensor.markers]
spacing_mm = 2.0
radius_mm = 0.5
[force]
kernel_size = 3
hidden = 6
clamp = false
[training]
normals_epochs = 1
normals_batch_px = 4096
force_epochs = 3
"""
COUNTS = {"train": 24, "validation": 8, "test": 8}
GRID = np.stack(np.meshgrid(np.arange(4, SIZE, 8.0), np.arange(4, SIZE, 8.0)), axis=-1).reshape(-1, 2)


def picture(centres_px, depth_mm):
    v, u = np.indices((SIZE, SIZE))
    distance = np.sqrt((u[..., None] - centres_px[:, 0]) ** 2 + (v[..., None] - centres_px[:, 1]) ** 2)
    dark = np.clip(2.5 - distance, 0, 1).max(axis=-1, initial=0)
    slopes = np.gradient(depth_mm, PITCH)
    light = np.stack([170 + 60 * sign * slope for sign in (1, -1) for slope in slopes], axis=-1)
    return np.clip(light * (1 - 0.9 * dark[..., None]), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """The scene's file and a dataset whose force is stiffness times displacement, stiffer along x."""
    folder, rng = tmp_path_factory.mktemp("drawn"), np.random.default_rng(1)
    v, u = np.indices((SIZE, SIZE))
    frames, normals, depths, shears, forces = [], [], [], [], []
    for _ in range(sum(COUNTS.values())):
        at, shear = rng.uniform(10, SIZE - 10, 2), rng.uniform(-0.2, 0.2, 2)
        bump = np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / 40)
        depth = -rng.uniform(0.1, 0.3) * bump
        tangential = bump[..., None] * shear
        moved = GRID + tangential[GRID[:, 1].astype(int), GRID[:, 0].astype(int)] / PITCH
        q, p = np.gradient(depth, PITCH)
        normal = np.stack([-p, -q, np.ones_like(p)], axis=-1)
        frames.append(picture(moved, depth))
        normals.append(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
        depths.append(depth)
        shears.append(tangential)
        whole = np.concatenate([tangential, -depth[..., None]], axis=-1)
        forces.append((whole * (1 + 2 * u / SIZE)[..., None]).sum(axis=(0, 1)) * PITCH**2)
    path = folder / "drawn.h5"
    dataset.write(
        path,
        pitch_mm=PITCH,
        channels=("B", "G", "R", "NIR"),
        source="simulated: drawn",
        background=picture(GRID, np.zeros((SIZE, SIZE))),
        split=np.repeat(list(COUNTS), list(COUNTS.values())),
        frames=np.stack(frames),
        normals=np.stack(normals),
        depth_mm=np.stack(depths),
        tangential_mm=np.stack(shears),
        force_n=np.stack(forces),
        rest_depth_mm=np.zeros((SIZE, SIZE)),
    )
    (folder / "drawn.toml").write_text(TEXT)
    return folder / "drawn.toml", path


@pytest.fixture(scope="module")
def written(drawn, tmp_path_factory):
    output = tmp_path_factory.mktemp("out")
    return output, invoke(drawn, output)


def invoke(drawn, output, *options):
    arguments = [str(drawn[0]), "--data", str(drawn[1]), "-o", str(output), "--store", str(output / "store")]
    arguments += ["--no-progress", *options]
    return CliRunner().invoke(main, ["study", "force-ablation", *arguments])


@pytest.mark.full
def test_all_six_forms_on_both_displacements(written):
    output, result = written
    assert result.exit_code == 0, result.output
    content = json.loads((output / "force_ablation.json").read_text())
    assert content["source"] == "simulated: drawn"
    assert content["frames"] == COUNTS
    assert (output / "force_ablation.png").read_bytes()[:4] == b"\x89PNG"
    shown = [re.split(r"\s{2,}", line) for line in result.output.splitlines()]
    for kind in ("true", "found"):
        results = content["displacements"][kind]["results"]
        assert list(results) == [" ".join(pair) for pair in FORCE_MAE_N]
        for (kernel, inputs), paper in FORCE_MAE_N.items():
            ours = results[f"{kernel} {inputs}"]["mae_n"]
            cells = [f"{a:.4f} ({b:.4f})" for a, b in zip(ours, paper, strict=True)]
            assert [kernel, inputs, *cells] in shown
    assert content["displacements"]["found"]["lost_frames"] == dict.fromkeys(COUNTS, 0)
    results = content["displacements"]["true"]["results"]
    full = results["dynamic xyz"]
    assert max(full["nmae_percent"]) < 1
    # What an input does not show, no kernel finds; and one kernel for all pixels is not this stiffness.
    assert results["dynamic xy"]["mae_n"][2] > 10 * full["mae_n"][2]
    assert results["dynamic z"]["mae_n"][0] > 10 * full["mae_n"][0]
    assert results["fixed xyz"]["mae_n"][2] > 3 * full["mae_n"][2]


def test_a_second_run_trains_nothing(written, drawn, monkeypatch):
    output, first = written

    def epoch(*_):
        raise AssertionError("trained again")

    monkeypatch.setattr(hyperforce_3d._Run, "epoch", epoch)
    monkeypatch.setattr(training, "normals", epoch)
    monkeypatch.setattr(displacement_3d, "displacement_fields", epoch)
    assert invoke(drawn, output).output == first.output


@pytest.mark.full
def test_an_interrupted_run_goes_on(written, drawn, monkeypatch):
    """From the epoch after which it was interrupted, to the same result; then no checkpoint is left."""
    output, first = written
    store = output / "store"
    assert not list((store / ".checkpoints").glob("*"))
    for entry in (store / "hyperforce").iterdir():
        if json.loads((entry / "step.json").read_text())["arguments"]["inputs"] == "z":
            shutil.rmtree(entry)
    epochs, epoch = [], hyperforce_3d._Run.epoch

    def counted(training, *arguments):
        epochs.append(len(training.history))
        if len(epochs) == 3:
            raise KeyboardInterrupt
        return epoch(training, *arguments)

    monkeypatch.setattr(hyperforce_3d._Run, "epoch", counted)
    assert invoke(drawn, output).exit_code == 1
    assert len(list((store / ".checkpoints").glob("hyperforce-*.npz"))) == 1
    assert invoke(drawn, output).output == first.output
    # Each of the four trainings has three epochs, of which the one interrupted is begun twice.
    assert epochs == [0, 1, 2, 2, *[0, 1, 2] * 3]
    assert not list((store / ".checkpoints").glob("*"))


def test_what_a_training_under_way_has_reached_is_of_one_input_only(drawn, tmp_path):
    """Another scene, other displacements or another form begin at the beginning."""
    scene, store = schema.load(drawn[0]), open_store(tmp_path)
    true = true_step(scene, drawn[1])

    def place(of=scene, step=true, kernel="dynamic", inputs="xyz"):
        known = {"store": tmp_path, "progress": False}
        return force_ablation.form_step(of, step.output(FILE), kernel, inputs, **known).unkeyed["checkpoint"]

    slower = scene.training.model_copy(update={"force_learning_rate": 1e-4})
    small = drawn[1].with_name("small.h5")
    shutil.copy(drawn[1], small)
    with h5py.File(small, "r+") as file:
        file["tangential_mm"][0] *= 2
    places = {
        place(),
        place(of=scene.model_copy(update={"training": slower})),
        place(step=true_step(scene, small)),
        place(kernel="fixed"),
        place(inputs="z"),
    }
    assert len(places) == 5
    assert place() in places
    assert all(path.parent.parent == store.folder for path in places)


def test_errors_by_hand():
    truth = np.array([[0.0, 1, 2], [2, -4, 0]])
    found = errors(truth + np.array([[1, 0, 0.5], [1, 2, -0.5]]), truth)
    assert found["mae_n"] == [1, 1, 0.5]
    np.testing.assert_allclose(found["rmse_n"], [1, np.sqrt(2), 0.5])
    np.testing.assert_allclose(found["nmae_percent"], [50, 25, 25])
    np.testing.assert_allclose(found["nrmse_percent"], [50, 100 * np.sqrt(2) / 4, 25])
    np.testing.assert_allclose(found["r2"], [0, 1 - 4 / 12.5, 0.75])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tangential_mm": None}, "d.h5: tangential_mm: missing"),
        ({"depth_mm": None}, "d.h5: depth_mm: missing"),
        ({"rest_depth_mm": None}, "d.h5: rest_depth_mm: missing"),
        ({"force_axes": ("z",)}, "d.h5: force_n: expected all of x, y, z"),
        ({"valid": np.zeros((40, SIZE, SIZE), bool)}, "d.h5: valid: geometry is known in parts only"),
        ({"split": np.repeat("train", 40)}, "d.h5: split: no frame is in 'validation'"),
    ],
)
def test_what_the_dataset_lacks(drawn, changes, message):
    settings, path = drawn
    data = replace(dataset.read(path), **changes)
    with pytest.raises(DatasetError, match=message):
        require(data, schema.load(settings), path.with_name("d.h5"), True)


def test_found_displacements_need_no_truth(drawn):
    settings, path = drawn
    data = replace(dataset.read(path), tangential_mm=None, depth_mm=None)
    require(data, schema.load(settings), path, False)


def test_a_missing_scene_is_one_line(drawn, tmp_path):
    result = invoke((tmp_path / "none.toml", drawn[1]), tmp_path)
    assert result.exit_code == 1
    assert len(result.output.strip().splitlines()) == 1
    assert "none.toml" in result.output
