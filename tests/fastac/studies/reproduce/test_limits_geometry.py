"""What each experiment switches off; the experiments themselves are run in test_run.py."""

import json

import numpy as np
import pytest

from fastac.scenes.sensor_schema import Light, Markers, Raw10
from fastac.store.files import load_arrays
from fastac.store.side_by_side import perform_all
from fastac.store.store import open_store
from fastac.studies.reproduce.limits_geometry import (
    IDEAL,
    NOISELESS,
    RECORDED,
    network_steps,
    seen_by,
    true_slopes,
    variants,
)

EVERYTHING = {"markers": Markers(), "light": Light(specular=0.1, cast_shadows=True)}


def test_each_variant_lacks_one_thing(make_scene):
    sensor = make_scene().sensor.model_copy(update=EVERYTHING)
    found = variants(sensor)
    assert found.pop(RECORDED) == sensor
    ideal = found.pop(IDEAL)
    changed = {
        name: {key for key, value in other if value != getattr(sensor, key)} for name, other in found.items()
    }
    assert changed == {
        NOISELESS: {"noise_dn", "electrons_per_dn"},
        "no grain of the paint": {"grain"},
        "no dots": {"markers"},
        "no gloss, no cast shadows": {"light"},
    }
    for name, keys in changed.items():
        for key in keys:
            assert getattr(ideal, key) == getattr(found[name], key)


def test_what_a_sensor_lacks_is_no_variant(make_scene):
    plain = make_scene(sensor={"grain": 0.0}).sensor
    assert list(variants(plain)) == [RECORDED, NOISELESS]
    still = plain.model_copy(update=dict(variants(plain)[NOISELESS]))
    assert list(variants(still)) == [RECORDED]


def test_a_raw_camera_is_stilled_too(make_scene):
    sensor = make_scene(sensor={"frames": "raw10"}).sensor
    still = variants(sensor)[NOISELESS].raw10
    assert (still.read_noise_dn, still.electrons_per_dn) == (0, 1e6)
    assert still.crosstalk == Raw10().crosstalk


def test_raw_frames_are_seen_as_channels_and_without_noise_alike(make_scene, tiny_data):
    still = variants(make_scene(sensor={"frames": "raw10"}).sensor)[NOISELESS]
    first, second = (
        seen_by(still, tiny_data, seed, label="frames", progress=False).frames for seed in (1, 2)
    )
    assert first.shape == tiny_data.frames.shape
    assert first.dtype == np.uint8
    assert np.abs(first.astype(int) - second).max() <= 1


def test_true_slopes_are_those_of_the_normals(tiny_data):
    slopes = true_slopes(tiny_data, np.array([2, 5]))
    normals = tiny_data.normals[[2, 5]]
    np.testing.assert_allclose(slopes[..., 0] * normals[..., 2], -normals[..., 0], atol=1e-7)
    np.testing.assert_allclose(slopes[..., 1] * normals[..., 2], -normals[..., 1], atol=1e-7)


@pytest.mark.full
def test_trainings_are_the_same_in_any_number_of_processes(make_scene, tiny_file, tmp_path):
    scene = make_scene(training={"normals_epochs": 1})
    found = []
    for processes in (1, 2):
        store = tmp_path / str(processes)
        trainings = network_steps(scene, tiny_file, store=store, progress=False)[RECORDED]
        assert list(trainings) == ["bgr", "bgr+nir"]
        steps = list(trainings.values())
        perform_all(store, steps, processes, label="networks", progress=False)
        assert all(open_store(store).is_current(step) for step in steps)
        entries = [open_store(store).perform(step) for step in steps]
        found.append([load_arrays(entry.path("normals.npz")) for entry in entries])
        errors = json.loads(entries[0].path("errors.json").read_text())
        assert set(errors) == {"gradient_mae_mm_per_px", "depth_mae_mm"}
    for one, two in zip(*found, strict=True):
        assert one.keys() == two.keys()
        for key, array in one.items():
            np.testing.assert_array_equal(array, two[key])


def test_frames_without_dots_are_judged_where_the_force_follows_dots(dotted_scene, dotted_file, tmp_path):
    """Neither the force's dots nor the bridge is looked for in frames that have none."""
    training = dotted_scene.training.model_copy(update={"normals_epochs": 1})
    scene = dotted_scene.model_copy(update={"training": training})
    steps = network_steps(scene, dotted_file, store=tmp_path, progress=False)
    for name, bridged in ((RECORDED, True), ("no dots", False), (IDEAL, False)):
        for step in steps[name].values():
            assert step.arguments["trained"].wants_bridge is bridged
    errors = open_store(tmp_path).perform(steps["no dots"]["bgr+nir"]).path("errors.json")
    assert json.loads(errors.read_text())["gradient_mae_mm_per_px"] > 0


def test_a_training_depends_on_what_it_reads(make_scene, tiny_file, tmp_path):
    def steps(training=None, **changes):
        scene = make_scene(training={"normals_epochs": 1} | (training or {}), **changes)
        return network_steps(scene, tiny_file, store=tmp_path, progress=False)[RECORDED]

    store = open_store(tmp_path)
    store.perform(steps()["bgr+nir"])
    # It is kept while only the integers' words, the hardware or the force change.
    for changes in (
        {"numbers": {"kernel_bits": 5}, "hardware": {"pixels_per_clock": 2}},
        {"force": {"kernel_size": 3}},
    ):
        assert store.is_current(steps(**changes)["bgr+nir"]), changes
    for changes in (
        {"numbers": {"slope_limit": 2}},
        {"poisson": {"mode": "difference"}},
        {"training": {"seed": 2}},
        {"sensor": {"pitch_mm": 0.2}},
    ):
        assert not store.is_current(steps(**changes)["bgr+nir"]), changes
