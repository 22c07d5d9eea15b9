import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest

from fastac.flow import training
from fastac.flow.build import Build, BuildError
from fastac.models.floating import pipeline
from fastac.models.integer import assemble, bundle
from fastac.models.integer.dst2d import Solver
from fastac.models.training.force import hyperforce
from fastac.sensor import dataset
from fastac.store.files import load_arrays

TRAIN = ["normals", "integers", "force", "bundle"]
QUICK = {"normals_epochs": 1, "finetune_epochs": 1}


def run(scene, folder, data, until: str = "bundle") -> dict[str, str]:
    """The steps that were announced, and whether they ran."""
    announced = {}

    def announce(name, state):
        assert name not in announced
        announced[name] = {"kept": "kept", "running": "ran"}[state]

    Build(scene, folder, data, progress=False).run(announce, until=until)
    return announced


def interrupt(*_, **__):
    raise KeyboardInterrupt


def ran(announced: dict[str, str]) -> list[str]:
    return [name for name, what in announced.items() if what == "ran"]


@pytest.fixture
def folder(tiny_folder, tmp_path):
    """The trained build in a folder that may be changed, with the store that it is from."""
    shutil.copytree(tiny_folder.parent / "store", tmp_path / "store")
    return shutil.copytree(tiny_folder, tmp_path / "tiny")


def write(data, path, **changes):
    """The dataset in another file, with changes."""
    parts = {**vars(data), **changes}
    dataset.write(path, **parts)
    return path


class TestResumes:
    def test_a_second_run_keeps_everything(self, tiny_scene, tiny_file, folder):
        before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        assert run(tiny_scene, folder, tiny_file) == dict.fromkeys(TRAIN, "kept")
        assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before

    @pytest.mark.parametrize(
        ("file", "step"), [("normals.npz", "normals"), ("integers.npz", "integers"), ("force.npz", "force")]
    )
    def test_a_lost_file_comes_from_the_store(self, tiny_scene, tiny_file, folder, file, step):
        lost = (folder / file).read_bytes()
        (folder / file).unlink()
        assert ran(run(tiny_scene, folder, tiny_file)) == []
        assert (folder / file).read_bytes() == lost

    def test_a_file_lost_in_the_store_is_made_again_and_nothing_else(self, tiny_scene, tiny_file, folder):
        (kept,) = (folder.parent / "store" / "integers").rglob("integers.npz")
        lost = kept.read_bytes()
        kept.unlink()
        assert ran(run(tiny_scene, folder, tiny_file)) == ["integers"]
        assert (folder / "integers.npz").read_bytes() == lost  # the same training gives the same file

    def test_a_damaged_bundle_is_put_back(self, tiny_scene, tiny_file, folder, tiny_bundle):
        shutil.rmtree(folder / "bundle")
        (folder / "bundle").mkdir()
        (folder / "bundle" / "bundle.json").write_text("{}")
        assert ran(run(tiny_scene, folder, tiny_file)) == []
        assert bundle.load(folder / "bundle").digest == tiny_bundle.digest

    @pytest.mark.parametrize(
        ("changes", "expected"),
        [
            ({"hardware": {"clock_mhz": 99.0}}, ["bundle"]),
            ({"simulation": {"frames": 2}}, ["bundle"]),
            ({"poisson": {"mode": "difference"}}, ["force", "bundle"]),
            ({"force": {"hidden": 8}}, ["force", "bundle"]),
            ({"numbers": {"weight_bits": 7}}, ["integers", "force", "bundle"]),
            ({"training": {"seed": 2}}, ["normals", "integers", "force", "bundle"]),
        ],
    )
    def test_only_what_a_setting_concerns_runs_again(
        self, make_scene, tiny_file, folder, tiny_bundle, changes, expected
    ):
        changed = make_scene(**changes)
        assert ran(run(changed, folder, tiny_file)) == expected
        found = bundle.load(folder / "bundle")
        assert found.scene == changed
        assert found.digest != tiny_bundle.digest
        assert ran(run(changed, folder, tiny_file)) == []

    def test_a_training_for_depth_begins_from_the_kept_network(
        self, make_scene, tiny_file, tmp_path, monkeypatch
    ):
        """Interrupted, or with another setting, it trains no normals again; it ends as if in one go."""
        settings = {**QUICK, "depth_weight": 0.5, "depth_epochs": 1}
        first, other = (make_scene(training={**settings, "depth_weight": weight}) for weight in (0.5, 0.4))
        with monkeypatch.context() as patch:
            patch.setattr(training.sums_of_slopes, "train", interrupt)
            with pytest.raises(KeyboardInterrupt):
                run(first, tmp_path / "first", tiny_file, until="normals")
        in_one_go = tmp_path / "in_one_go.npz"
        training.normals(dataset.read(tiny_file), other, in_one_go, progress=False)
        monkeypatch.setattr(training.train_normals, "train", interrupt)
        for name, scene in (("first", first), ("other", other)):
            assert ran(run(scene, tmp_path / name, tiny_file, until="normals"))
        found, expected = load_arrays(tmp_path / "other" / "normals.npz"), load_arrays(in_one_go)
        assert list(found) == list(expected)
        assert {"history.normals.epoch", "history.sums.epoch"} <= set(found)
        assert all(np.array_equal(found[name], values) for name, values in expected.items())

    def test_other_data_train_everything_again(self, tiny_scene, tiny_data, folder, tmp_path):
        other = write(
            tiny_data, tmp_path / "other.h5", source="simulated: another day", photograph_px=(320, 240)
        )
        assert ran(run(tiny_scene, folder, other)) == TRAIN
        assert bundle.load(folder / "bundle").pipeline.provenance == {
            "source": "simulated: another day",
            "frames": 34,
            "channels": ["B", "G", "R", "NIR"],
            "photograph_px": [320, 240],
        }

    def test_an_interrupted_training_goes_on_with_its_step(
        self, make_scene, tiny_file, tmp_path, monkeypatch
    ):
        scene = make_scene(training={"normals_epochs": 1, "finetune_epochs": 0})
        monkeypatch.setattr(hyperforce, "train", interrupt)
        with pytest.raises(KeyboardInterrupt):
            run(scene, tmp_path / "b", tiny_file)
        assert not (tmp_path / "b" / "bundle").exists()
        monkeypatch.undo()
        assert ran(run(scene, tmp_path / "b", tiny_file)) == ["force", "bundle"]

    def test_the_last_step_is_the_one_asked_for(self, tiny_scene, tiny_file, folder):
        announced = run(tiny_scene, folder, tiny_file, until="evaluate")
        assert list(announced) == [*TRAIN, "evaluate"]
        assert ran(announced) == ["evaluate"]
        assert not (folder / "verilog").exists()
        found = json.loads((folder / "accuracy.json").read_text())
        assert (found["split"], found["frames"]) == ("test", 8)
        assert ran(run(tiny_scene, folder, tiny_file, until="evaluate")) == []


def test_without_a_recording_the_fingertip_is_pressed(make_scene, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # no worker processes for 12 presses
    scene = make_scene(
        protocol={"train_grid": 2, "validation_grid": 1, "test_grid": 1},
        training={"normals_epochs": 1, "finetune_epochs": 1, "force_epochs": 1},
    )
    assert ran(run(scene, tmp_path / "b", None)) == ["data", *TRAIN]
    data = dataset.read(tmp_path / "b" / "data.h5", scene)
    assert [len(data.indices(split)) for split in dataset.SPLITS] == [8, 2, 2]
    harder = scene.model_copy(update={"protocol": scene.protocol.model_copy(update={"loads_n": (0.1,)})})
    assert ran(run(harder, tmp_path / "b", None)) == ["data", *TRAIN]
    assert len(dataset.read(tmp_path / "b" / "data.h5")) == 6


def test_a_recorded_scene_needs_its_recording(make_scene, tmp_path):
    scene = make_scene(outputs=["depth"], sensor={"source": "recorded"})
    with pytest.raises(BuildError, match=r"scene tiny: sensor.source = 'recorded': give the recording"):
        Build(scene, tmp_path / "b")
    assert not (tmp_path / "b").exists()


def test_hardware_that_the_device_cannot_hold_is_refused_before_anything_is_trained(make_scene, tmp_path):
    scene = make_scene(
        sensor={"height_px": 256, "width_px": 256, "geometry": "flat"},
        hardware={"pixels_per_clock": 4, "weights": "baked"},
    )
    with pytest.raises(BuildError, match=r"scene tiny: 2,1\d\d DSP48E2 .* has 1,968; choose fewer hardware"):
        Build(scene, tmp_path / "b")
    assert not (tmp_path / "b").exists()


def test_kernels_that_the_device_cannot_hold_are_refused_before_anything_is_trained(make_scene, tmp_path):
    changes = {
        "outputs": ["force_xyz"],
        "sensor": {"height_px": 256, "width_px": 256, "geometry": "flat"},
        "force": {"kernel_size": 7},
    }
    # 254² words of 7 · 7 · 3 · 12 = 1,764 bits are 113.8 Mbit, and the device's RAMB36 hold 36.3 ...
    with pytest.raises(BuildError, match=r"scene tiny: 3,111.5 RAMB36 \(force 3,111.5\): .* has 984; ch"):
        Build(make_scene(**changes, numbers={"kernel_bits": 12}), tmp_path / "b")
    assert not (tmp_path / "b").exists()
    # ... and none where one weight a pixel has the same resultant.
    changes["force"]["kernel"] = "collapsed"
    Build(make_scene(**changes, numbers={"kernel_bits": 12}), tmp_path / "b")


def test_hardware_that_the_part_cannot_hold_is_refused_before_anything_is_trained(make_scene, tmp_path):
    """What the scene alone does not say: memories but the kernels', and look-up tables."""
    large = {"height_px": 128, "width_px": 128, "geometry": "flat"}
    # The paper's transposers and transforms beside kernels of 3 × 3.
    wide = make_scene(
        sensor=large,
        numbers={"kernel_bits": 12},
        force={"kernel_size": 3},
        hardware={"part": "xck26-sfvc784-2LV-c"},
    )
    build = Build(wide, tmp_path / "b", progress=False)
    announced = []
    with pytest.raises(BuildError, match=r"scene tiny: 1\d\d(\.5)? RAMB36 \(.*transposition .* has 144; ch"):
        build.run(lambda *step: announced.append(step))
    assert announced == []
    baked = make_scene(
        outputs=["force_xyz"],
        sensor=large,
        poisson={"mode": "difference", "solver": "adjoint"},
        network={"width": 24},
        force={"clamp": False, "fit": "slopes"},
        hardware={"part": "xc7z020clg400-1", "weights": "baked", "pixels_per_clock": 4},
    )
    with pytest.raises(BuildError, match=r"scene tiny: [\d,]+ look-up tables by estimate .* has 53,200; ch"):
        Build(baked, tmp_path / "b", progress=False).run(lambda *step: announced.append(step))
    assert announced == []


class TestOnlyWhatIsWanted:
    def test_normals_alone(self, make_scene, tiny_file, tmp_path, monkeypatch):
        def refuse(*_, **__):
            raise AssertionError("nobody asked for depth or force")

        monkeypatch.setattr(hyperforce, "train", refuse)
        monkeypatch.setattr(Solver, "fitted", refuse)
        monkeypatch.setattr(assemble, "quantise_weights", refuse)
        monkeypatch.setattr(pipeline, "solve", refuse)
        scene = make_scene(outputs=["normals"], training=QUICK)
        announced = run(scene, tmp_path, tiny_file, until="evaluate")
        assert list(announced) == ["normals", "integers", "bundle", "evaluate"]
        assert not (tmp_path / "force.npz").exists()
        found = bundle.load(tmp_path / "bundle")
        self.check_absent(found, tmp_path, ("source", "solver", "depth", "quantiser", "force"))
        errors = json.loads((tmp_path / "accuracy.json").read_text())
        assert not [key for key in errors["integer"] if "depth" in key or "force" in key]
        assert set(errors["saturated_values"]) == {"gradient_saturated"}

    def test_depth_without_force(self, make_scene, tiny_file, tmp_path, monkeypatch):
        def refuse(*_, **__):
            raise AssertionError("nobody asked for force")

        monkeypatch.setattr(hyperforce, "train", refuse)
        monkeypatch.setattr(assemble, "quantise_weights", refuse)
        monkeypatch.setattr(assemble, "DisplacementQuantiser", refuse)
        scene = make_scene(outputs=["normals", "depth"], training=QUICK)
        announced = run(scene, tmp_path, tiny_file, until="evaluate")
        assert "force" not in announced
        assert not (tmp_path / "force.npz").exists()
        found = bundle.load(tmp_path / "bundle")
        assert found.pipeline.solver is not None
        self.check_absent(found, tmp_path, ("quantiser", "force"))
        errors = json.loads((tmp_path / "accuracy.json").read_text())
        assert "depth_mae_mm" in errors["integer"]
        assert not [key for key in errors["integer"] if "force" in key]

    @staticmethod
    def check_absent(found, folder, stages):
        for stage in stages:
            assert getattr(found.pipeline, stage) is None
        assert found.pipeline.force_n_per_unit is None
        assert not [name for name in found.floats if "force" in name]
        with np.load(folder / "bundle" / "integers.npz") as archive:
            assert not {name.split(".")[0] for name in archive.files} & set(stages)


class TestDataMustFit:
    @pytest.mark.parametrize(
        ("lost", "message"),
        [
            ("normals", "normals: missing, and scene tiny trains the pixel network on them"),
            ("force_n", "force_n: missing, and scene tiny wants"),
            ("rest_depth_mm", "rest_depth_mm: missing, and a curved skin needs its boundary prior"),
        ],
    )
    def test_ground_truth_is_missing(self, tiny_scene, tiny_data, tmp_path, lost, message):
        path = write(tiny_data, tmp_path / "d.h5", **{lost: None})
        with pytest.raises(training.TrainingError, match=message) as caught:
            run(tiny_scene, tmp_path / "b", path)
        assert str(path) in str(caught.value)
        assert not list((tmp_path / "b").glob("*"))

    def test_what_an_earlier_scene_did_not_need(self, make_scene, tiny_data, tmp_path):
        """Normals were trained without the skin at rest; depth must not take it for flat."""
        path = write(tiny_data, tmp_path / "d.h5", rest_depth_mm=None, force_n=None)
        run(make_scene(outputs=["normals"], training=QUICK), tmp_path / "b", path)
        with pytest.raises(training.TrainingError, match="rest_depth_mm: missing"):
            run(make_scene(outputs=["depth"], training=QUICK), tmp_path / "b", path)
        with pytest.raises(training.TrainingError, match="force_n: missing"):
            run(make_scene(outputs=["force_z"], training=QUICK), tmp_path / "b", path)

    @pytest.mark.parametrize("split", ["train", "test"])
    def test_a_split_is_missing(self, tiny_scene, tiny_data, tmp_path, split):
        names = np.where(tiny_data.split == split, "validation", tiny_data.split)
        path = write(tiny_data, tmp_path / "d.h5", split=names)
        with pytest.raises(training.TrainingError, match=f"split: no frame is in '{split}'"):
            run(tiny_scene, tmp_path / "b", path)

    def test_a_flat_skin_needs_no_prior_and_no_validation_split(self, make_scene, tiny_data, tmp_path):
        scene = make_scene(
            outputs=["depth"],
            sensor={"geometry": "flat"},
            training=QUICK,
        )
        flat = replace(tiny_data, split=np.where(tiny_data.split == "validation", "test", tiny_data.split))
        path = write(flat, tmp_path / "d.h5", rest_depth_mm=None, depth_mm=None, force_n=None)
        run(scene, tmp_path / "b", path)
        found = bundle.load(tmp_path / "b" / "bundle").pipeline
        assert not found.rest_depth_mm.any()
        assert not found.source.offset.any()
