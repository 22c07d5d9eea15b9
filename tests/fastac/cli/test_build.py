import json
import re
import shutil

import pytest
from command_line import fail, succeed
from two_builds import FASTER, build

STEPS = ("data", "normals", "integers", "force", "bundle", "evaluate", "verilog", "sim", "report")


def test_report_prints_the_summary(tiny_folder, tiny_file, tmp_path):
    folder = shutil.copytree(tiny_folder, tmp_path / "tiny")
    (folder / "verilog").mkdir()
    (folder / "verilog" / "hardware.json").write_text(
        json.dumps({"latency_cycles_by_formula": {"stage": {"normals": 10}}, "multipliers": {"normals": 10}})
    )
    (folder / "accuracy.json").write_text(
        json.dumps({"frames": 8, "float": {}, "integer": {}, "growth_percent": {}, "saturated_values": {}})
    )
    simulated = {"frames": 2, "values_compared": 50_000, "mismatches": 0, "frame_indices": [30, 33]}
    simulated |= {"values_by_output": {}, "markers_compared": 0, "errors": 0}
    simulated["latency_cycles"] = {"first_pixel_to_force": 1234}
    (folder / "sim.json").write_text(json.dumps(simulated))
    picture = tmp_path / "picture.png"
    lines = succeed("report", folder, "--data", tiny_file, "--picture", picture).stdout.splitlines()
    cells = [re.split(r"\s{2,}", line) for line in lines]
    assert cells[0] == ["", "here", "paper"]
    assert cells[1][0] == "RTL against integer model"
    assert "0 mismatches in 50,000 values, 2 frames" in cells[1][1]
    assert any(line[1:] == ["1,234", "about 163,500"] for line in cells)
    assert lines[-1] == str(folder / "report.html")
    assert (folder / "report.json").exists()
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_no_results_no_report(tiny_folder, tiny_file, tmp_path):
    folder = shutil.copytree(tiny_folder, tmp_path / "tiny")
    assert "accuracy.json" in fail("report", folder, "--data", tiny_file)
    assert fail("report", folder) == f"{folder}/data.h5: no such file"


@pytest.mark.long
def test_a_scene_from_frames_to_the_report(toml, tmp_path, one_process):
    """Frames, trained integers, Verilog, its simulation, the report; a second run does nothing."""
    text = toml.read_text().replace("[poisson]\n", '[poisson]\nsolver = "tridiagonal"\n')
    text = text.replace("train_grid = 3", "train_grid = 2").replace(
        "[numbers]", "[network]\nwidth = 4\n[numbers]"
    )
    text = text.split("[training]")[0] + "[simulation]\nframes = 2\n[training]\n"
    toml.write_text(text + "normals_epochs = 1\nfinetune_epochs = 1\nforce_epochs = 1\n")
    folder = tmp_path / "build" / "tiny"
    command = ("build", toml, "-o", folder, "--no-progress")
    first = succeed(*command)
    report = json.loads((folder / "report.json").read_text())
    found = report["rtl_vs_integer"]
    assert (found["frames"], found["mismatches"]) == (2, 0)
    assert found["values_compared"] == 2 * (16 * 16 * 3 + 14 * 14 + 1)
    latency = report["latency_cycles"]
    assert latency["initiation_interval"] == 16 * 16
    assert sum(latency["stage"].values()) == latency["first_pixel_to_force"]
    assert {"float", "integer"} <= report["accuracy"].keys()
    assert report["accuracy"]["integer"].keys() >= {"normal_mae_deg", "depth_mae_mm", "force_mae_n"}
    assert report["resources"]["dsp48e2"]["value"] > 0
    assert "<html" in (folder / "report.html").read_text()
    assert "0 mismatches in 1,930 values, 2 frames" in first.stdout
    assert first.stdout.splitlines()[-1] == str(folder / "report.html")

    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    again = succeed(*command)
    assert again.stdout == first.stdout
    assert "running" in first.stderr
    assert "running" not in again.stderr
    reasons = succeed(*command, "--why").stdout.splitlines()
    assert [line.split() for line in reasons] == [[name, "current"] for name in STEPS]
    toml.write_text(toml.read_text().replace("force_epochs = 1", "force_epochs = 2"))
    reasons = dict(line.split(maxsplit=1) for line in succeed(*command, "--why").stdout.splitlines())
    assert {reasons[name] for name in STEPS[:3]} == {"current"}
    assert reasons["force"] == "scene training.force_epochs = 2 was 1"
    assert all(reasons[name].startswith("needs force: ") for name in STEPS[4:])
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()} == before


def test_two_builds_are_compared(tmp_path):
    one, two = build(tmp_path / "one"), build(tmp_path / "two", **FASTER)
    page = tmp_path / "new" / "page.html"
    lines = succeed("compare", one, two, "-o", page).stdout.splitlines()
    assert lines[-1] == str(page)
    assert ["first", "pixel", "to", "force", "600", "150", "-75.0%"] in [line.split() for line in lines]
    assert "<h1>one and two</h1>" in page.read_text()
    assert fail("compare", one, two, "-o", page) == f"{page}: exists already; --force replaces it"
    succeed("compare", two, one, "-o", page, "--force")
    assert "<h1>two and one</h1>" in page.read_text()
    assert fail("compare", one, tmp_path).startswith(f"{tmp_path}: no report.json in it")
