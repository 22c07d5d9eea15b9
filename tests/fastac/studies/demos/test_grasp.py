"""A bottle that slips without feedback and holds with it, through the integers of a tiny bundle."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.protocol import FingertipError
from fastac.studies.demos import grasp as experiment
from fastac.studies.demos.bottle import Grasp, HeldBottle
from fastac.studies.demos.grip_control import GripControl, friction_ratio, without_feedback

BRIEF = Grasp(pushes_n=(0.02, 0.048), push_s=0.2, pause_s=0.05, step_deg=0.01, most_deg=0.2)


def of_scene(bundle, scene):
    return replace(bundle, pipeline=bundle.pipeline.replace(scene=scene))


@pytest.fixture(scope="module")
def written(tiny_rig_bundle, tiny_rig_cache, tmp_path_factory):
    folder = tmp_path_factory.mktemp("grasp") / "g"
    content = experiment.run(tiny_rig_bundle, folder, grasp=BRIEF, store=tiny_rig_cache, progress=False)
    return folder, content


@pytest.mark.full
def test_it_slips_without_feedback_and_holds_with_it(written):
    folder, content = written
    assert json.loads((folder / "grasp.json").read_text()) == content
    assert (folder / "grasp.png").read_bytes().startswith(b"\x89PNG")
    without, with_feedback = content["without_feedback"], content["with_feedback"]
    assert without["slipped"]
    assert without["tightened_deg"] == 0
    assert not with_feedback["slipped"]
    assert with_feedback["slipped_mm"] == 0
    assert with_feedback["tightened_deg"] > 0
    assert content["source"] == "simulated"
    assert content["delay_frames"] == 1


@pytest.mark.full
def test_the_series_are_those_of_the_contact(written):
    _, content = written
    for name in ("without_feedback", "with_feedback"):
        one = content[name]
        series = {key: np.array(value) for key, value in one["series"].items()}
        assert set(map(len, series.values())) == {one["frames"]} == {round(0.55 * 240)}
        friction = content["friction"]
        # Nodes tilt against each other, so that the resultants' ratio may pass the nodes' friction a little.
        assert friction_ratio(series["true_n"]).max() < 1.1 * friction
        assert (np.diff(series["slipped_mm"]) >= 0).all()
        assert (np.diff(series["tightened_deg"]) >= 0).all()
        error = np.abs(series["found_n"] - series["true_n"]).mean(axis=0)
        assert list(one["force_error_n"].values()) == pytest.approx(error)
    ratio = friction_ratio(np.array(content["with_feedback"]["series"]["found_n"]))
    tightened = np.diff(content["with_feedback"]["series"]["tightened_deg"]) > 0
    limit = content["stable_ratio"] + content["margin"]
    at_most = np.array(content["with_feedback"]["series"]["tightened_deg"][1:]) >= BRIEF.most_deg
    np.testing.assert_array_equal(tightened | at_most, (ratio[:-1] > limit) | at_most)


def test_the_controller_sees_found_forces_only(tiny_rig_bundle, tiny_rig_cache):
    rig = rig_of(tiny_rig_bundle.scene.sensor, tiny_rig_cache, progress=False)
    pipeline, seen = tiny_rig_bundle.pipeline, []

    class Control(GripControl):
        def __call__(self, force_n, slip_px):
            seen.append(force_n)
            assert slip_px is None  # the scene has no slip
            return super().__call__(force_n, slip_px)

    whole = BRIEF.of_scene(tiny_rig_bundle.scene)
    doubled = replace(
        tiny_rig_bundle, pipeline=pipeline.replace(force_n_per_unit=2 * pipeline.force_n_per_unit)
    )
    for bundle in (tiny_rig_bundle, doubled):
        control = Control(without_feedback, 0.1, 1.0)
        trace = experiment.run_control_loop(
            bundle, HeldBottle(rig, whole), [0.0, 0.01], control, "", progress=False
        )
        np.testing.assert_array_equal(trace.found_force_n, seen[-2:])
    np.testing.assert_allclose(seen[2:], 2 * np.array(seen[:2]))


def test_no_slip_no_experiment(tiny_rig_bundle, tiny_rig_cache, monkeypatch):
    rig = rig_of(tiny_rig_bundle.scene.sensor, tiny_rig_cache, progress=False)
    monkeypatch.setattr(experiment, "SLIP_TEST_PUSH", 0.01)
    monkeypatch.setattr(experiment, "SLIP_TEST_FRAMES", 3)
    with pytest.raises(FingertipError, match="no push makes the bottle slip"):
        experiment.slip_test(tiny_rig_bundle, rig, BRIEF.of_scene(tiny_rig_bundle.scene), progress=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": ["force_z"]}, "grasp: outputs = force_z: expected force_xyz"),
        ({"outputs": ["force_xyz"]}, r"grasp: sensor\.elastomer\.friction = 0: expected more"),
        ({"outputs": ["force_xyz"], "sensor": {"source": "recorded"}}, "expected 'simulated'"),
    ],
)
def test_refuses_scenes_that_cannot_show_it(changes, message, tiny_rig_bundle, make_scene, tmp_path):
    with pytest.raises(FingertipError, match=message):
        experiment.run(of_scene(tiny_rig_bundle, make_scene(**changes)), tmp_path, progress=False)
    assert not any(tmp_path.iterdir())


def test_the_command(tiny_rig_folder, tiny_rig_cache, tmp_path):
    base = ["grasp", str(tiny_rig_folder), "--store", str(tiny_rig_cache), "--no-progress"]
    result = CliRunner().invoke(main, [*base, "--grip-n", "0", "-o", str(tmp_path / "g")])
    assert result.exit_code == 1
    assert "Error: grasp: grip_n = 0.0: expected more than 0" in result.output
    assert not (tmp_path / "g").exists()
    assert CliRunner().invoke(main, ["grasp", "--help"]).exit_code == 0


@pytest.fixture(scope="module")
def written_with_slip(slip_bundle, tiny_rig_cache, tmp_path_factory):
    folder = tmp_path_factory.mktemp("grasp") / "g"
    content = experiment.run(slip_bundle, folder, grasp=BRIEF, store=tiny_rig_cache, progress=False)
    return folder, content


@pytest.mark.full
def test_slip_closes_the_fingers_frame_by_frame(written_with_slip):
    folder, content = written_with_slip
    assert json.loads((folder / "grasp.json").read_text()) == content
    assert (folder / "grasp.png").read_bytes().startswith(b"\x89PNG")
    one = content["with_slip_feedback"]
    series = one["series"]
    assert set(map(len, series.values())) == {one["frames"]}
    flagged = np.array(series["slipping"])
    assert 0 < flagged.sum() == one["slipping_frames"]
    spread_px = np.where(flagged, series["slip_px"], 0)
    rises = np.diff(np.maximum.accumulate([0, *spread_px])) > 0
    wanted = np.minimum(BRIEF.step_deg * np.cumsum(rises), BRIEF.most_deg)
    assert content["delay_frames"] == 1
    np.testing.assert_allclose(series["tightened_deg"], [0, *wanted[:-1]])
    assert content["without_feedback"]["tightened_deg"] == 0


@pytest.mark.full
def test_the_first_flag_is_that_of_the_series(written_with_slip):
    for name in experiment.RUNS:
        one = written_with_slip[1][name]
        series, first = one["series"], one["first_slipping"]
        if not one["slipping_frames"]:
            assert first is None
            continue
        index = series["slipping"].index(True)
        assert first["time_s"] == series["time_s"][index]
        assert first["sticking"] == series["sticking"][index]
        assert 0 <= first["sticking"] <= 1


@pytest.mark.full
def test_a_table_with_slip(written_with_slip):
    _, content = written_with_slip
    [table] = experiment.tables(content)
    assert [row[0] for row in table.rows] == ["without feedback", "with feedback", "with slip feedback"]
    assert table.head[-2:] == ["flagged from, s", "sticking then, %"]
    assert all(len(row) == len(table.head) for row in table.rows)
    [table] = experiment.tables(
        content | {"with_slip_feedback": content["with_slip_feedback"] | {"first_slipping": None}}
    )
    assert table.rows[-1][-2:] == ["", ""]


@pytest.mark.full
def test_scenes_without_slip_say_nothing_of_it(written):
    _, content = written
    assert "with_slip_feedback" not in content
    assert "limit_px" not in content
    for name in ("without_feedback", "with_feedback"):
        assert not {"first_slipping", "slipping_frames"} & set(content[name])
        assert "slip_px" not in content[name]["series"]


@pytest.mark.full
def test_the_table_says_who_slips(written):
    [table] = experiment.tables(written[1])
    assert [row[:2] for row in table.rows] == [["without feedback", "slips"], ["with feedback", "holds"]]
    assert all(len(row) == len(table.head) for row in table.rows)
    assert table.note.endswith("simulated")
