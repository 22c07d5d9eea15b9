import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fastac.flow.build import Build
from fastac.gateware.cycle_model import cycles
from fastac.models import accuracy
from fastac.models.integer.force import PatchForce
from fastac.scenes.schema import TANGENTIAL_SHARES
from fastac.sensor import samples
from fastac.store.likeness import likeness
from fastac.store.steps import needed_steps
from fastac.store.store import open_store
from fastac.sweep import point_steps
from fastac.sweep.points import PointModels, Setting, code_digest, point_code


@pytest.fixture(scope="module")
def setting(tiny_file, tmp_path_factory):
    return Setting(str(tmp_path_factory.mktemp("cache")), str(tiny_file), "test", 5)


@pytest.fixture(scope="module")
def tiny(tiny_scene, setting):
    models = PointModels(tiny_scene, setting)
    open_store(Path(setting.store)).perform(models.point)
    return models


@pytest.mark.parametrize(("friction", "shares"), [(0.0, ()), (1.0, TANGENTIAL_SHARES)])
def test_points_learn_from_drags_where_friction_carries_them(tiny_scene, friction, shares):
    rubber = tiny_scene.sensor.elastomer.model_copy(update={"friction": friction, "mechanics": "fem"})
    scene = tiny_scene.model_copy(
        update={"sensor": tiny_scene.sensor.model_copy(update={"elastomer": rubber})}
    )
    models = PointModels(scene, Setting("unused", None, "test", 5))
    assert models.shared["data"].arguments["scene"].tangential_shares == shares


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
    found = open_store(Path(tiny.setting.store)).value(tiny.point)
    for name, value in expected["integer"].items():
        assert found[name] == value
        assert found[f"float_{name}"] == expected["float"][name]
    assert found["force_z_mae_n"] == found["force_mae_n"]
    known = cycles(tiny.scene)
    assert found["latency_cycles"] == max(known["first_pixel_to_force"], known["first_pixel_to_depth"])
    assert set(point_steps.origins()) <= set(found)


def test_the_code_is_that_of_steps_schema_and_all_kinds(setting):
    found = point_code(Path(setting.store))
    assert "fastac.synth.estimates.solvers:poisson.solver[tridiagonal]" in found
    assert "fastac.scenes.outputs:outputs[force_map]" in found
    assert "fastac.scenes.model_schema.Numbers" in found["fastac.scenes.schema:Scene"].symbols


@pytest.mark.full
def test_the_code_does_not_depend_on_what_else_was_imported(setting):
    ask = f"import sys; from pathlib import Path; {{}}; print(code_digest(Path({setting.store!r})))"
    mine = "from fastac.sweep.points import code_digest"
    digests = [
        subprocess.run([sys.executable, "-c", ask.format(lines)], capture_output=True, text=True, check=True)
        for lines in (mine, f"import fastac.studies.reproduce.run, fastac.sensor.mechanics.objects; {mine}")
    ]
    assert digests[0].stdout == digests[1].stdout == f"{code_digest(Path(setting.store))}\n"


def likenesses(make_scene, setting, **changes) -> dict[str, str]:
    """What each training has in common with others that give the same, once the tiny scene is trained."""
    models = PointModels(make_scene(**changes), setting)
    return {name: likeness(open_store(Path(setting.store)), step) for name, step in models.shared.items()}


ALL = {"normals", "integers", "force_start", "float_errors"}


@pytest.mark.parametrize(
    ("changes", "anew"),
    [
        ({"hardware": {"pixels_per_clock": 2}}, set()),
        ({"numbers": {"data_bits": 20, "kernel_bits": 6}}, set()),
        ({"numbers": {"rounding": "floor"}}, set()),
        ({"name": "other", "simulation": {"frames": 9}}, set()),
        ({"force": {"kernel": "collapsed"}}, set()),
        ({"poisson": {"mode": "difference"}}, {"float_errors"}),
        ({"numbers": {"weight_bits": 5}}, {"integers"}),
        ({"training": {"finetune_epochs": 9}}, {"integers"}),
        ({"training": {"force_epochs": 9}}, {"force_start", "float_errors"}),
        ({"force": {"kernel_size": 3}}, {"force_start", "float_errors"}),
        ({"poisson": {"divergence": "backward"}}, {"force_start", "float_errors"}),
        ({"outputs": ["depth", "force_xyz"]}, {"force_start", "float_errors"}),
        ({"network": {"width": 8}}, ALL),
        ({"training": {"normals_epochs": 9}}, ALL),
    ],
)
def test_what_is_trained_anew(tiny, make_scene, setting, changes, anew):
    base, other = likenesses(make_scene, setting), likenesses(make_scene, setting, **changes)
    assert {name for name in base if base[name] != other[name]} - anew == set()
    assert anew - {name for name in base if base[name] != other[name]} == set()


def test_no_force_no_force_model(make_scene, setting):
    assert "force_start" not in PointModels(make_scene(outputs=["depth"]), setting).shared


def test_simulated_frames_are_a_step(make_scene, setting):
    shared = PointModels(make_scene(), Setting(setting.store, None, "test", 5)).shared
    assert next(iter(shared)) == "data"
    assert shared["data"] in needed_steps(shared["normals"])


def test_the_build_s_trainings_are_the_points(tiny, tiny_scene, setting, tiny_file, tmp_path):
    """A build beside the store of a sweep does not train again what the sweep has trained."""
    place = tmp_path / "builds"
    place.mkdir()
    (place / "store").symlink_to(setting.store)
    announced = {}
    Build(tiny_scene, place / "tiny", tiny_file, progress=False).run(announced.__setitem__, until="integers")
    assert announced == {"normals": "kept", "integers": "kept"}
