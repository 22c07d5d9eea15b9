"""Two builds compared: keys, figures, relative differences, and folders that are no build."""

import pytest
from two_builds import FASTER, REPORT, build

from fastac.report import comparison, differences
from fastac.report.differences import Difference
from fastac.store.files import DamagedFileError


@pytest.fixture
def shown(tmp_path):
    return comparison.read((build(tmp_path / "one"), build(tmp_path / "two", **FASTER)))


def rows(shown, title: str) -> dict[str, list[str]]:
    [table] = [table for table in shown.tables if table.title == title]
    return {row[0]: list(row[1:]) for row in table.rows}


def test_only_keys_that_differ_are_listed(shown):
    assert rows(shown, "The scenes") == {
        "name": ["one", "two"],
        "poisson.solver": ["dst2d", "tridiagonal"],
        "hardware.pixels_per_clock": ["1", "2"],
    }


def test_keys_that_one_scene_lacks_or_leaves_unset(tmp_path):
    markers = {"spacing_mm": 1.0}
    other = build(tmp_path / "b", scene__sensor__markers=markers, scene__protocol__loads_n=[0.1, 0.3])
    shown = comparison.read((build(tmp_path / "a"), other))
    assert rows(shown, "The scenes") == {
        "sensor.markers": ["unset", "–"],
        "sensor.markers.spacing_mm": ["–", "1.0"],
        "protocol.loads_n": ["0.1, 0.2", "0.1, 0.3"],
    }


def test_figures_with_their_relative_differences(shown):
    assert rows(shown, "Errors of the integers") == {
        "depth_mae_mm": ["0.025", "0.03", "+20.0%"],
        "force_z_mae_n": ["0.04", "0.04", "="],
        "force_z_r2": ["0.95", "0.99", "+4.2%"],
    }
    assert rows(shown, "Cycles")["first pixel to force"] == ["600", "150", "-75.0%"]
    assert rows(shown, "Resources")["dsp48e2"] == ["200", "10", "× 0.05"]
    assert rows(shown, "Resources")["dsp48e2_by_module, normals"] == ["150", "150", "="]
    assert rows(shown, "Energy") == {"estimated µJ a frame": ["2", "2", "="]}
    assert rows(shown, "Hardware against integers")["mismatches"] == ["0", "3", "+3"]
    assert rows(shown, "What each stage adds, cycles")["source"] == ["499", "499", "="]


def test_one_axis_is_compared_with_the_same_axis_of_three(tmp_path):
    errors = {"force_mae_n": 0.01, "force_x_mae_n": 0.002, "force_z_mae_n": 0.02}
    changes = {"scene__outputs": ["depth", "force_xyz"], "accuracy__integer": errors}
    shown = comparison.read((build(tmp_path / "a"), build(tmp_path / "b", **changes)))
    found = rows(shown, "Errors of the integers")
    assert found["force_z_mae_n"] == ["0.04", "0.02", "-50.0%"]
    assert found["force_mae_n"] == ["–", "0.01", ""]


@pytest.mark.parametrize(
    ("a", "b", "better", "relative", "verdict"),
    [
        (2.0, 1.0, -1, "-50.0%", "good"),
        (1.0, 2.0, -1, "+100.0%", "bad"),
        (1.0, 2.0, 1, "+100.0%", "good"),
        (1.0, 2.0, 0, "+100.0%", ""),
        (1.0, 10.0, -1, "× 10", "bad"),
        (1.0, 0.0, -1, "-100.0%", "good"),
        (0.0, 3.0, -1, "+3", "bad"),
        (-1.0, -3.0, 1, "-2", "bad"),
        (None, 1.0, -1, "", ""),
        (5, 5, -1, "=", ""),
    ],
)
def test_relative_differences(a, b, better, relative, verdict):
    found = Difference("x", a, b, better)
    assert (found.relative, found.verdict) == (relative, verdict)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, ""),
        ({"frames_are": "recorded photographs"}, "different frames: simulated and recorded photographs"),
        ({"scene__protocol__seed": 2}, "different simulated frames"),
        ({"data": {"source": "simulated: seed 2"}}, "different simulated frames"),
        ({"scene__poisson": {"solver": "tridiagonal"}}, ""),
    ],
)
def test_errors_on_different_frames_are_called_so(tmp_path, changes, text):
    shown = comparison.read((build(tmp_path / "a"), build(tmp_path / "b", **changes)))
    found = differences.caution(shown.a, shown.b)
    assert text in found
    assert bool(text) == bool(found)
    assert found in shown.text


def test_equal_builds(tmp_path):
    text = comparison.read((build(tmp_path / "x" / "same"), build(tmp_path / "y" / "same"))).text
    assert "No key of the scenes differs." in text
    assert "%" not in text
    assert str(tmp_path / "x" / "same") in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"accuracy": None}, "accuracy: Input should be a valid dictionary"),
        ({"scene": {**REPORT["scene"], "hardware": {}}}, "scene.hardware.pixels_per_clock: Field required"),
        ({"latency_cycles_by_formula": {"stage": {}}}, "latency_cycles_by_formula.stage: Dictionary should"),
        ({"resources": {"lut": 3}}, "resources.lut: Input should be a valid dictionary"),
        (
            {"accuracy": {"float": {}, "integer": {"x": float("nan")}}},
            "accuracy.integer.x: Input should be a",
        ),
        ({"energy_estimate_uj_per_frame": 3}, "energy_estimate_uj_per_frame: Input should be a valid dict"),
    ],
)
def test_a_damaged_report_is_one_line(tmp_path, change, message):
    path = build(tmp_path / "a", **change) / "report.json"
    with pytest.raises(DamagedFileError) as caught:
        differences.read(tmp_path / "a")
    assert str(caught.value).startswith(f"{path}: {message}")
    for text in ("[]", "{", "9" * 5000):
        path.write_text(text)
        with pytest.raises(DamagedFileError, match=r"report\.json: "):
            differences.read(tmp_path / "a")


def test_what_is_no_build(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere: no such folder; give the folder of a finished"):
        differences.read(tmp_path / "nowhere")
    (tmp_path / "file").write_text("")
    with pytest.raises(FileNotFoundError, match="file: no such folder"):
        differences.read(tmp_path / "file")
    with pytest.raises(FileNotFoundError, match=r"no report\.json in it: no finished build"):
        differences.read(tmp_path)
