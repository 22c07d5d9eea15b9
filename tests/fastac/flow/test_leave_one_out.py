"""From photographs and a force gauge's readings to integers, and what they are worth on groups left out."""

import json
import re
import shutil
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from fastac.cli.main import main
from fastac.flow import leave_one_out, simple_models
from fastac.flow.build import Build
from fastac.flow.intervals import scale_of, training_groups
from fastac.flow.steps import LEFT_OUT
from fastac.flow.training import TrainingError, require
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle
from fastac.models.integer.force_interval import INTERVAL
from fastac.sensor import dataset
from fastac.sensor.fingertip import generate
from fastac.store.files import load_arrays

GROUPS = ("ball", "cup", "nut")


@pytest.fixture(scope="module")
def scene(make_scene):
    return make_scene(
        outputs=["force_z"],
        sensor={"channels": "bgr", "source": "recorded", "geometry": "flat"},
        numbers={"activation_bits": 10},
        poisson={"solver": "adjoint"},
        force={"clamp": False, "fit": "slopes"},
        training={"labels": "force", "force_epochs": 2, "force_batch": 20, "finetune_epochs": 1},
    )


@pytest.fixture(scope="module")
def recording(scene, make_scene, tmp_path_factory):
    """152 presses of the virtual sensor as photographs after two of its rest, in three groups by chance."""
    place = tmp_path_factory.mktemp("recording")
    pressed = make_scene(
        outputs=["force_z"],
        sensor={"channels": "bgr", "geometry": "flat"},
        protocol={"train_grid": 5, "validation_grid": 2, "test_grid": 3, "loads_n": [0.01, 0.03, 0.05, 0.07]},
    )
    generate(pressed, place / "simulated.h5", progress=False, processes=1)
    data = dataset.read(place / "simulated.h5")
    rows = ["frame,force_z_n,group"]
    (place / "frames").mkdir()
    order = np.random.default_rng(1).permutation(len(data))
    for k, image in enumerate([data.background] * 2 + [data.frames[i] for i in order]):
        Image.fromarray(np.ascontiguousarray(image[..., ::-1])).save(place / "frames" / f"{k}.png")
        if k >= 2:
            rows.append(f"{k},{data.force_n[order[k - 2], 2]},{GROUPS[k * 3 // (len(data) + 2)]}")
    (place / "forces.csv").write_text("\n".join(rows))
    return place


@pytest.fixture(scope="module")
def data_file(recording):
    run(
        *("import", "force", recording / "frames", "--forces", recording / "forces.csv"),
        *("--background-frames", 2, "--pitch-mm", 0.25, "--height-px", 16, "--width-px", 16),
        *("-o", recording / "d.h5", "--no-progress"),
    )
    return recording / "d.h5"


@pytest.fixture(scope="module")
def build_folder(scene, data_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("build")
    Build(scene, folder, data_file, progress=False).run(lambda name, current: None, until="evaluate")
    return folder


def run(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments], prog_name="fastac")
    assert result.exit_code == code, result.output
    return result


class Alleged:
    """A store whose steps train nothing: errors of what is trained grow with the seed. It counts steps."""

    def __init__(self):
        self.asked = Counter()

    def is_current(self, step):
        return False

    def value(self, step):
        self.asked[step.name, step.arguments["group"]] += 1
        if step.name == "simple_models":
            return dict(zip(simple_models.MODELS, (6.0, 8.0, 10.0), strict=True))
        seed = step.arguments["scene"].training.seed
        errors = {model: seed * (1.0 + k) for k, model in enumerate(leave_one_out.TRAINED)}
        return {"frames": len(step.arguments["group"]), "mae_n": errors}


def test_the_integers_find_unseen_forces_as_the_floats_do(build_folder, data_file):
    errors = json.loads((build_folder / "accuracy.json").read_text())
    data = dataset.read(data_file)
    truth = data.force_n[data.indices("test"), 0]
    blind = np.abs(truth - data.force_n[data.indices("train"), 0].mean()).mean()
    assert errors["float"]["force_mae_n"] < 0.5 * blind
    assert errors["integer"]["force_mae_n"] < 1.1 * errors["float"]["force_mae_n"]
    assert "normal_mae_deg" not in errors["float"]


@pytest.mark.full
def test_intervals_follow_from_errors_of_groups_left_out(scene, build_folder, data_file):
    """Both splits of a recording have frames of each object, so the validation split tells of no new one."""
    wanted = scene.model_copy(update={"force": scene.force.model_copy(update={"coverage": 0.9})})
    data, folder = dataset.read(data_file), build_folder.with_name("intervals")
    assert training_groups(data) == ["ball", "cup"]
    Build(wanted, folder, data_file, progress=False).run(lambda name, current: None, until="bundle")
    pipeline, plain = (bundle.load(place / "bundle").pipeline for place in (folder, build_folder))
    assert pipeline.provenance[INTERVAL] == {
        "asked": 0.9,
        "coverage": 2 / 3,
        "groups": 2,
        "frames": int((data.split != "test").sum()),
        "trainings": 2,
    }
    np.testing.assert_array_equal(pipeline.force.weight, plain.force.weight)
    assert "left_out_groups" not in Build(scene, folder, data_file).steps
    # The widest of all scores is needed: every frame of the groups is within its interval.
    left_out = load_arrays(folder / LEFT_OUT)
    assert left_out["group"].tolist() == sorted(left_out["group"].tolist())
    scale = scale_of(pipeline, data)
    factor = pipeline.interval.base[0] * 2.0 ** pipeline.interval.exponent[0] / scale.base[0]
    assert factor * pipeline.force_n_per_unit[0] == pytest.approx(left_out["scores"].max(), rel=1e-3)


def test_the_hardware_gets_a_sum_over_the_slopes_that_is_zero_at_rest(build_folder, data_file):
    pipeline = bundle.load(build_folder / "bundle").pipeline
    assert pipeline.solver is None
    assert pipeline.force.weight.shape == (1, 16, 16, 2)
    assert not Emulator(pipeline).run(dataset.read(data_file).background[None]).force_raw.any()


def test_datasets_must_know_the_axes_that_are_wanted(scene, data_file):
    data = dataset.read(data_file)
    require(data, scene, data_file)
    shear = scene.model_copy(update={"outputs": ("force_xyz",)})
    with pytest.raises(TrainingError, match=r"d\.h5: force_n: no x axis, and scene tiny wants"):
        require(data, shear, data_file)
    with pytest.raises(TrainingError, match=r"d\.h5: force_n: missing"):
        require(replace(data, force_n=None), scene, data_file)


class TestLeaveOneGroupOut:
    def evaluate(self, build_folder, data_file, *more, code=0):
        arguments = ("evaluate", build_folder, "--data", data_file, "--leave-one-group-out", "--no-progress")
        return run(*arguments, *more, code=code)

    def test_every_group_is_tested_once_by_models_that_never_saw_it(
        self, build_folder, data_file, tmp_path, monkeypatch
    ):
        seen = []
        train = leave_one_out.train

        def observed(data, *arguments, **keys):
            seen.append({split: set(data.group[data.indices(split)]) for split in dataset.SPLITS})
            return train(data, *arguments, **keys)

        monkeypatch.setattr(leave_one_out, "train", observed)
        alone = ("--jobs", 1)
        result = self.evaluate(build_folder, data_file, "--json", tmp_path / "e.json", *alone)
        assert [entry["test"] for entry in seen] == [{name} for name in GROUPS]
        for entry in seen:
            assert entry["train"] == entry["validation"] == set(GROUPS) - entry["test"]
        content = json.loads((tmp_path / "e.json").read_text())
        (once,) = content["runs"]
        assert sum(entry["frames"] for entry in once["groups"].values()) == 152
        for model in leave_one_out.MODELS:
            values = [entry["mae_n"][model] for entry in once["groups"].values()]
            assert once["mean_mae_n"][model] == pytest.approx(np.mean(values))
        lines = result.stdout.splitlines()
        head = ["left out", "frames", *(f"{model}, N" for model in leave_one_out.MODELS)]
        assert re.split(r"\s{2,}", lines[0]) == head
        assert [line.split()[0] for line in lines[1:]] == [*GROUPS, "mean"]
        # What is there is not trained again: not all of it, nor what an interruption has left.
        again = self.evaluate(build_folder, data_file)
        assert again.stdout == result.stdout
        assert len(seen) == 3
        (second,) = [
            path.parent
            for path in (build_folder.parent / "store" / "left_out").rglob("step.json")
            if json.loads(path.read_text())["arguments"]["group"] == GROUPS[1]
        ]
        shutil.rmtree(second)
        assert self.evaluate(build_folder, data_file).stdout == result.stdout
        assert len(seen) == 4

    @pytest.mark.full
    def test_side_by_side_as_one_after_the_other(self, build_folder, data_file, scene, tmp_path):
        """Every group in a process of its own; one that fails ends them all."""
        data = dataset.read(data_file)
        kept = build_folder.parent / "store"
        spawned = partial(ProcessPoolExecutor, 2, get_context("spawn"))
        one = leave_one_out.evaluate(data, scene, data_file, kept, progress=False)
        assert (
            leave_one_out.evaluate(data, scene, data_file, tmp_path / "many", start=spawned, progress=False)
            == one
        )
        wide = scene.model_copy(update={"outputs": ("force_xyz",)})
        with pytest.raises(dataset.DatasetError, match="force_n: x: not measured"):
            leave_one_out.evaluate(
                data, wide, data_file, tmp_path / "none", start=partial(ThreadPoolExecutor, 2), progress=False
            )

    @pytest.mark.parametrize(("option", "value"), [("--jobs", 2), ("--seeds", "1,2")])
    def test_options_of_groups(self, build_folder, data_file, option, value):
        message = run("evaluate", build_folder, "--data", data_file, option, value, code=2).stderr
        assert message.endswith(f"{option} is for --leave-one-group-out\n")

    def test_means_over_seeds(self, scene, data_file, tmp_path, monkeypatch):
        """Every seed trains without every group; of the mean over groups the spread over seeds is printed."""
        kept = Alleged()
        monkeypatch.setattr(leave_one_out, "open_store", lambda folder: kept)
        data = dataset.read(data_file)
        content = leave_one_out.evaluate(data, scene, data_file, tmp_path, seeds=[1, 3], progress=False)
        assert content["seeds"] == [1, 3]
        *groups, mean = leave_one_out.rows(content["runs"], digits=2)
        simple = ["6.00", "8.00", "10.00"]
        assert groups == [[name, len(name), "2.00", "4.00", *simple] for name in GROUPS]
        assert mean == ["mean", None, *(f"{2 * k}.00 ± {2**0.5 * k:.2f}" for k in (1, 2)), *simple]
        once = kept.asked["simple_models", GROUPS[0]]
        assert kept.asked["left_out", GROUPS[0]] == 2 * once, "no seed changes simple models"
        own = leave_one_out.evaluate(data, scene, data_file, tmp_path, progress=False)
        assert own["seeds"] == [scene.training.seed]

    def test_refuses_what_has_no_groups(self, build_folder, data_file, tmp_path):
        data = dataset.read(data_file)
        dataset.write(tmp_path / "d.h5", **{**vars(data), "group": None})
        message = self.evaluate(build_folder, tmp_path / "d.h5", code=1).stderr
        assert message.endswith("d.h5: group: missing, so there is nothing to leave out\n")
        dataset.write(tmp_path / "d.h5", **{**vars(data), "group": np.full(len(data), "cup")})
        message = self.evaluate(build_folder, tmp_path / "d.h5", code=1).stderr
        assert message.endswith("d.h5: group = 'cup' alone: expected at least two\n")

    def test_refuses_models_of_geometry(self, make_scene, data_file):
        with pytest.raises(dataset.DatasetError, match=r"training\.labels = 'geometry': groups"):
            leave_one_out.check(dataset.read(data_file), make_scene(), data_file)
