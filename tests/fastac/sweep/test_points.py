from threading import Thread

import numpy as np
import pytest

from fastac.gateware.cycle_model import cycles
from fastac.models import accuracy
from fastac.models.integer.force import PatchForce
from fastac.sensor import samples
from fastac.sweep import points
from fastac.sweep.points import PointModels, Setting, Step


@pytest.fixture(scope="module")
def setting(tiny_file, tmp_path_factory):
    return Setting(str(tmp_path_factory.mktemp("cache")), str(tiny_file), "test", 5)


@pytest.fixture(scope="module")
def tiny(tiny_scene, setting):
    models = PointModels(tiny_scene, setting)
    for step in models.steps.values():
        step.perform()
    return models


def test_the_integers_are_those_of_the_build(tiny, tiny_bundle):
    found, expected = tiny.pipeline, tiny_bundle.pipeline
    for mine, theirs in zip(found.layers, expected.layers, strict=True):
        np.testing.assert_array_equal(mine.weight, theirs.weight)
        np.testing.assert_array_equal(mine.bias, theirs.bias)
    assert isinstance(found.force, PatchForce)
    np.testing.assert_array_equal(found.force.kernel, expected.force.kernel)
    for name, values in tiny.floats.items():
        np.testing.assert_array_equal(values, tiny_bundle.floats[name], err_msg=name)


def test_the_errors_are_those_of_evaluate(tiny, tiny_bundle, tiny_data):
    index = samples.evenly_spaced(tiny_data.indices("test"), 5)
    expected, _ = accuracy.compare_pipelines(tiny_bundle, tiny_data, index, progress=False)
    found = tiny.metrics()
    for name, value in expected["integer"].items():
        assert found[name] == value
        assert found[f"float_{name}"] == expected["float"][name]
    assert found["force_z_mae_n"] == found["force_mae_n"]
    known = cycles(tiny.scene)
    assert found["latency_cycles"] == max(known["first_pixel_to_force"], known["first_pixel_to_depth"])
    assert set(points.origins()) <= set(found)


def keys(make_scene, setting, **changes):
    steps = PointModels(make_scene(**changes), setting).steps
    return {name: step.key for name, step in steps.items()}


@pytest.mark.parametrize(
    ("changes", "anew"),
    [
        ({"hardware": {"pixels_per_clock": 2}}, set()),
        ({"numbers": {"data_bits": 20, "kernel_bits": 6}}, set()),
        ({"numbers": {"rounding": "floor"}}, set()),
        ({"name": "other", "simulation": {"frames": 9}}, set()),
        ({"force": {"kernel": "collapsed"}}, set()),
        ({"poisson": {"mode": "difference"}}, {"float"}),
        ({"numbers": {"weight_bits": 5}}, {"integers"}),
        ({"training": {"finetune_epochs": 9}}, {"integers"}),
        ({"training": {"force_epochs": 9}}, {"force", "float"}),
        ({"force": {"kernel_size": 3}}, {"force", "float"}),
        ({"poisson": {"divergence": "backward"}}, {"force", "float"}),
        ({"outputs": ["depth", "force_xyz"]}, {"force", "float"}),
        ({"network": {"width": 8}}, {"normals", "integers", "force", "float"}),
        ({"training": {"normals_epochs": 9}}, {"normals", "integers", "force", "float"}),
        ({"sensor": {"noise_dn": 2.0}}, {"normals", "integers", "force", "float"}),
    ],
)
def test_what_is_trained_anew(make_scene, setting, changes, anew):
    base, other = keys(make_scene, setting), keys(make_scene, setting, **changes)
    assert {name for name in base if base[name] != other[name]} == anew


def test_no_force_no_force_model(make_scene, setting):
    assert "force" not in keys(make_scene, setting, outputs=["depth"])


def test_simulated_frames_are_a_step(make_scene, setting):
    without = Setting(setting.cache, None, "test", 5)
    steps = PointModels(make_scene(), without).steps
    assert next(iter(steps)) == "data"
    assert steps["data"] in steps["normals"].needs
    assert keys(make_scene, without, outputs=["normals"])["data"] == steps["data"].key
    assert keys(make_scene, without, protocol={"seed": 2})["data"] != steps["data"].key


def test_workers_that_race_train_once(tmp_path):
    runs = []

    def run(path):
        runs.append(path)
        path.write_text("trained")

    step = Step("normals", "key", tmp_path / "normals" / "key.npz", (), run)
    workers = [Thread(target=step.perform) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert runs == [step.path]


def test_a_step_that_fails_leaves_nothing(tmp_path):
    def run(path):
        raise RuntimeError("lost")

    step = Step("normals", "key", tmp_path / "key.npz", (), run)
    with pytest.raises(RuntimeError, match="lost"):
        step.perform()
    assert not step.path.exists()
