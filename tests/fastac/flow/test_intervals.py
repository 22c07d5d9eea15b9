"""Intervals around the forces of a trained sensor: calibrated over places that were not trained on."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import fastac
from fastac.cli.main import main
from fastac.flow import force_training, steps, training
from fastac.flow.few_presses import presses
from fastac.flow.intervals import widened
from fastac.gateware.calibration import calibration_words
from fastac.models.accuracy import with_background_of
from fastac.models.integer.force_interval import INTERVAL
from fastac.models.interval_accuracy import remark
from fastac.report.content import interval_rows


@pytest.fixture(scope="module")
def made(make_scene, tiny_folder, tiny_data, tmp_path_factory):
    """Makes a bundle of the same force with intervals of a coverage, or without."""
    normals, integers = tiny_folder / steps.NORMALS, tiny_folder / steps.INTEGERS
    force = tmp_path_factory.mktemp("force") / steps.FORCE  # not fitted to what intervals are calibrated on
    known = make_scene(force={"coverage": 0.6})
    force_training.force(tiny_data, known, normals, integers, force, progress=False)
    arrays = [training.load_arrays(path) for path in (normals, integers, force)]

    def make(coverage: float | None):
        scene = make_scene(force={"coverage": coverage})
        folder = tmp_path_factory.mktemp("intervals") / "bundle"
        return training.assemble(tiny_data, scene, *arrays, folder), folder

    return make


@pytest.fixture(scope="module")
def common(made):
    return made(0.6)


def test_intervals_hold_what_they_were_calibrated_on(made, common, tiny_data):
    bundle, _ = common
    pipeline = bundle.pipeline
    assert pipeline.provenance[INTERVAL] == {
        "asked": 0.6,
        "coverage": 0.6,
        "groups": 4,
        "frames": 8,
        "trainings": 0,
    }
    assert remark(pipeline) is None
    index = tiny_data.indices("validation")
    found = with_background_of(pipeline, tiny_data).run(tiny_data.frames[index])
    inside = np.abs(found.force_n - tiny_data.forces_n(index, (2,))) <= found.force_half_width_n
    # Of 5 groups with the same share, one of them infinite, 3 must be reached.
    assert 0.75 <= inside.mean() < 1
    assert (found.force_half_width_n > 0).all()
    one = fastac.load(common[1]).run(tiny_data.frames[index[0]])
    assert one.force_half_width_n.tolist() == found.force_half_width_n[0].tolist()
    # Nothing else has changed.
    plain = with_background_of(made(None)[0].pipeline, tiny_data).run(tiny_data.frames[index])
    assert plain.force_half_width_n is None
    np.testing.assert_array_equal(plain.force_raw, found.force_raw)


def test_too_few_groups_give_what_they_can(made, common):
    bundle, _ = made(0.9)
    pipeline = bundle.pipeline
    assert pipeline.provenance[INTERVAL] == {
        "asked": 0.9,
        "coverage": 0.8,
        "groups": 4,
        "frames": 8,
        "trainings": 0,
    }
    assert remark(pipeline) == (
        "force.coverage = 0.9: 4 groups support at most 80.0%, which the intervals are made for: as wide as"
        " the worst frame asks"
    )
    bases = [
        each.base[0] * 2.0 ** each.exponent[0] for each in (pipeline.interval, common[0].pipeline.interval)
    ]
    assert bases[0] > bases[1]


def test_a_validation_split_is_needed(make_scene, tiny_data, tmp_path):
    without = replace(tiny_data, split=np.where(tiny_data.split == "test", "test", "train"))
    training.require(without, make_scene(), tmp_path)
    with pytest.raises(training.TrainingError, match="split: no press is in 'validation' alone"):
        training.require(without, make_scene(force={"coverage": 0.9}), tmp_path)


def test_commands_tell_them(common, made, tiny_file, tmp_path):
    _, folder = common
    runner, output, file = CliRunner(), tmp_path / "out.h5", tmp_path / "errors.json"
    arguments = ["evaluate", str(folder), "--data", str(tiny_file), "--json", str(file), "--no-progress"]
    found = runner.invoke(main, arguments, catch_exceptions=False)
    assert "intervals, force_z: " in found.output
    assert "under drift, force_z: " in found.output
    assert "4 groups; 60% asked" in found.output
    assert "support" not in found.output
    content = json.loads(file.read_text())[INTERVAL]
    rows = interval_rows(content, "simulated")
    assert [row[0] for row in rows] == [
        "forces within their intervals, promised",
        "force_z within its interval",
        "force_z within its interval under drift",
    ]
    assert rows[0][1] == "60%"
    assert interval_rows({}, "simulated") == []

    runner.invoke(main, ["predict", str(folder), str(tiny_file), "-o", str(output)], catch_exceptions=False)
    with h5py.File(output) as written:
        assert written["force_half_width_n"].shape == written["force_n"].shape
        assert written.attrs["force_coverage"] == 0.6
    found = runner.invoke(
        main, ["evaluate", str(made(0.95)[1]), "--data", str(tiny_file)], catch_exceptions=False
    )
    assert "force.coverage = 0.95: 4 groups support at most 80.0%" in found.output
    assert interval_rows(content | {"asked": 0.9}, "simulated")[0][1] == "90% asked, 60% supported"


def test_another_unit_s_intervals_hold_its_presses(common, tiny_data):
    """Of a stiffer unit they are wider by the same in all frames, and its words can be loaded."""
    bundle, _ = common
    stiff = replace(tiny_data, force_n=3 * tiny_data.force_n)
    new, about, text = widened(bundle, bundle.pipeline, stiff)
    press = presses(stiff)
    index = np.flatnonzero((stiff.split != "test") & (press != ""))
    count = len(set(press[index]))
    assert about[INTERVAL] == {
        "asked": 0.6,
        "coverage": 0.6,
        "groups": count,
        "frames": len(index),
        "trainings": 0,
    }
    assert text.startswith("widened: z by ")
    assert text.endswith(f"N; made for 60.0% of presses, by {count}")
    before, after = (
        with_background_of(pipeline, stiff).run(stiff.frames[index]) for pipeline in (bundle.pipeline, new)
    )
    more = after.force_half_width_n - before.force_half_width_n
    assert more.min() > 0
    assert np.ptp(more) < 1.01 * new.force_n_per_unit[0]  # but for what the floor drops
    error = np.abs(after.force_n - stiff.forces_n(index, (2,)))
    names, of_press = np.unique(press[index], return_inverse=True)
    inside = (error <= after.force_half_width_n)[:, 0]
    shares = np.bincount(of_press, inside) / np.bincount(of_press)
    assert shares.sum() / (len(names) + 1) >= 0.6
    words = calibration_words(replace(bundle, pipeline=new), bundle)
    assert (words != calibration_words(bundle, bundle)).any()


def test_another_unit_s_intervals_are_never_narrower(common, made, tiny_data):
    bundle, _ = common
    pipeline = bundle.pipeline
    found = with_background_of(pipeline, tiny_data).run(tiny_data.frames)
    as_found = replace(tiny_data, force_n=np.pad(found.force_n, ((0, 0), (2, 0))))
    new, _, text = widened(bundle, pipeline, as_found)
    np.testing.assert_array_equal(new.interval.base, pipeline.interval.base)
    assert text.startswith("widened: z by 0.0000 N")
    without = replace(tiny_data, force_n=None)
    found = widened(bundle, pipeline, without)
    assert found[0] is pipeline
    assert found[1][INTERVAL] == pipeline.provenance[INTERVAL]
    assert found[2] == "as they were: the presses have no force"
    plain = made(None)[0]
    assert widened(plain, plain.pipeline, tiny_data) == (plain.pipeline, {}, "none")
