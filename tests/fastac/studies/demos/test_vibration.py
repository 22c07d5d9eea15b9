"""A vibration through the integers of a tiny bundle: what is recovered, what aliases, what is refused."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.gateware.cycle_model import cycles
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.protocol import FingertipError
from fastac.studies.demos import vibration

SHORT = vibration.Vibration(seconds=0.2)


def of_scene(bundle, scene):
    return replace(bundle, pipeline=bundle.pipeline.replace(scene=scene))


@pytest.fixture(scope="module")
def written(tiny_bundle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("vibration") / "v"
    content = vibration.run(tiny_bundle, folder, vibration=SHORT, progress=False)
    return folder, content


def test_each_pipeline_shows_the_input_or_its_alias(written):
    folder, content = written
    assert json.loads((folder / "vibration.json").read_text()) == content
    assert (folder / "vibration.png").read_bytes().startswith(b"\x89PNG")
    recovered = {
        (int(frequency), name)
        for frequency, found in content["frequencies"].items()
        for name, output in found["pipelines"].items()
        if output["recovered"]
    }
    fast = {(frequency, name) for frequency in (50, 70, 100) for name in ("FPGA", vibration.THIS_DESIGN)}
    assert recovered == fast | {(50, "CPU"), (50, "GPU"), (70, "GPU")}
    for found in content["frequencies"].values():
        assert all(output["as_expected"] for output in found["pipelines"].values())
        assert found["pipelines"][vibration.THIS_DESIGN]["dropped_frames"] == 0
    assert content["source"] == "simulated"


def test_the_table_has_the_paper_s_verdicts_beside_ours(written):
    [table] = vibration.tables(written[1])
    assert len(table.rows) == 12
    assert all(len(row) == len(table.head) for row in table.rows)
    verdicts = {tuple(row[:2]): tuple(row[-2:]) for row in table.rows}
    for (_, name), (ours, paper) in verdicts.items():
        assert paper == ("" if name == vibration.THIS_DESIGN else ours)


def test_true_forces_swing_between_the_ends_and_found_ones_follow(written, tiny_scene):
    _, content = written
    least, most = SHORT.ends_n(tiny_scene)
    assert (least, most) == pytest.approx((0.024, 0.056))
    assert content["vibration"] == {"seconds": 0.2, "least_n": least, "most_n": most}
    for found in content["frequencies"].values():
        true = np.array(found["true_force_z_n"])
        assert len(true) == 48
        assert (true >= least * (1 - 1e-6)).all()
        assert (true <= most * (1 + 1e-6)).all()
        assert np.ptp(true) > 0.8 * (most - least)
        assert np.corrcoef(true, found["found_force_z_n"])[0, 1] > 0.9
        error = np.array(found["found_force_z_n"]) - true
        assert found["force_error_n"]["mean_absolute"] == pytest.approx(np.abs(error).mean())


def test_finite_elements_and_raw10(tiny_rig_bundle, tiny_rig_cache, make_scene):
    rig = vibration.rig_of(tiny_rig_bundle.scene.sensor, tiny_rig_cache, progress=False)
    brief = vibration.Vibration(seconds=0.05)
    recording = vibration.record(tiny_rig_bundle, rig, brief, 50, progress=False)
    assert recording.found_force_n.shape == recording.true_force_n.shape == (12,)
    least, most = brief.ends_n(tiny_rig_bundle.scene)
    assert recording.true_force_n.max() < most * 1.02
    assert recording.true_force_n.min() > least * 0.98
    content = tiny_rig_bundle.scene.model_dump()
    content["sensor"]["frames"] = "raw10"
    raw = of_scene(tiny_rig_bundle, type(tiny_rig_bundle.scene).model_validate(content))
    assert vibration.record(raw, rig, brief, 50, progress=False).found_force_n.shape == (12,)


def test_this_design_s_rate_is_its_cycles(tiny_scene):
    ours = vibration.service_s(tiny_scene)[vibration.THIS_DESIGN]
    assert ours == Fraction(cycles(tiny_scene)["initiation_interval"], 150_000_000)


def test_refuses_what_it_cannot_show(tiny_bundle, make_scene, tmp_path):
    def refused(scene=None, match="", **keys):
        bundle = tiny_bundle if scene is None else of_scene(tiny_bundle, scene)
        with pytest.raises(FingertipError, match=match):
            vibration.run(bundle, tmp_path, vibration=vibration.Vibration(**keys), progress=False)

    refused(make_scene(outputs=["depth"]), "vibration: outputs = depth: expected force_z or force_xyz")
    refused(make_scene(sensor={"source": "recorded"}), r"vibration: sensor\.source = 'recorded'")
    refused(match="seconds = 0.01: expected 0.077 to 60", seconds=0.01)
    refused(match="load 0.04 N ± 0.04 N: expected 0 < amplitude < mean", amplitude_n=0.04, mean_n=0.04)
    big = vibration.Vibration(0.1, 90.0, 1.0)
    with pytest.raises(ContactError):
        vibration.run(tiny_bundle, tmp_path, vibration=big, progress=False)
    assert not any(tmp_path.iterdir())


@pytest.mark.full
def test_the_command(tiny_folder, tmp_path):
    arguments = [
        "vibration",
        str(tiny_folder),
        "--seconds",
        "0.1",
        "-o",
        str(tmp_path / "v"),
        "--no-progress",
    ]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "v").iterdir()} == {"vibration.json", "vibration.png"}
    for word in ("100 Hz", "aliased", "recovered", "simulated", "estimated"):
        assert word in result.output
    result = CliRunner().invoke(main, [*arguments, "--load-n", "-1"])
    assert result.exit_code == 1
    assert "expected 0 < amplitude < mean" in result.output
