import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.flow import verify
from fastac.models.integer import bundle
from fastac.sensor import samples
from fastac.studies.robustness import drift, extremes, words, worst_case_hardware
from fastac.studies.robustness import frames as extreme_frames


@pytest.fixture(scope="module")
def content(folder):
    """What the command writes, without the hardware."""
    kept = ["--store", str(folder.parent / "store")]
    result = CliRunner().invoke(main, ["study", "extremes", str(folder), "--no-rtl", *kept, "--no-progress"])
    assert result.exit_code == 0, result.output
    assert "every value of every frame is finite: yes" in result.output
    assert (folder / extremes.PLOT).stat().st_size > 10_000
    return json.loads((folder / extremes.FILE).read_text())


def test_every_word_is_in_the_table(content):
    rows = {(row["stage"], row["word"]): row for row in content["words"]}
    assert {stage for stage, _ in rows} >= {"layer 0", "source", "row_inverse", "depth", "force"}
    for row in rows.values():
        assert 0 < row["reached"] <= row["range_bound"] <= row["bound"] < 1 << (row["width_bits"] - 1), row
        assert row["head_room_bits"] >= 0
        assert "rtl_beats" not in row


def test_special_frames_are_finite_equal_and_flagged(content):
    rows = {row["frame"]: row for row in content["special_frames"]}
    assert tuple(rows) == verify.SPECIAL
    assert all(row["finite"] and row["emulator_vs_loop_mismatches"] == 0 for row in rows.values())
    assert {"clipped", "detail"} <= set(rows["black"]["reasons"])
    assert "clipped" in rows["missing pixels"]["reasons"]


def test_the_deepest_prior_is_the_last_one_that_is_accepted(content):
    prior = content["boundary_prior"]
    assert prior["emulator_vs_loop_mismatches"] == 0
    assert prior["largest_mm"] < prior["refused_mm"] < 1.1 * prior["largest_mm"]


def test_errors_and_flags_of_every_fault(content, tiny_bundle):
    rows = {(row["fault"], row["level"]): row for row in content["drift"]}
    names = {name for name, _ in rows}
    assert names == {
        "gain",
        "offset",
        "B light",
        "G light",
        "R light",
        "NIR light",
        "dead pixels",
        "defocus",
        "load",
    }
    good = rows["gain", 1.0]
    for name, level in (("offset", 0.0), ("B light", 1.0), ("dead pixels", 0), ("defocus", 0.0)):
        assert rows[name, level]["integer"] == good["integer"]
    for key in drift.ERRORS:
        assert rows["R light", 0.0]["integer"][key] > good["integer"][key]
    for channel in "BGR":
        assert rows[f"{channel} light", 0.0]["suspect_share"] == 1
        assert f"brightness_{channel.lower()}" in rows[f"{channel} light", 0.0]["reasons"]
    assert rows["dead pixels", 2]["suspect_share"] == 1
    assert content["good_frames"]["train"]["flagged"] == content["good_frames"]["validation"]["flagged"] == 0
    loads = [level for name, level in rows if name == "load"]
    assert loads == sorted(loads)
    assert loads[0] == drift.LIGHT_N


def test_frames_of_the_hardware_are_compared_once(tiny_bundle, tiny_folder, tmp_path, monkeypatch):
    """And again for another bundle; a difference names the stage."""
    asked = []

    def compare(case, folder, *, lanes):
        asked.append(case.name)
        if case.name == "source" and len(asked) > 30:
            raise SystemExit(1)
        return 7

    monkeypatch.setattr(words, "compare", compare)
    cases = words.worst_cases(tiny_bundle.pipeline)

    def rows(path):
        return words.rows(path, tmp_path, store=tmp_path / "store", rtl=True, progress=False)

    found = rows(tiny_folder / "bundle")
    assert len(asked) == len(cases) == len(found)
    assert all(row["rtl_beats"] == 7 and row["rtl_mismatches"] == 0 for row in found)
    assert rows(tiny_folder / "bundle") == found
    shutil.copytree(tiny_folder / "bundle", tmp_path / "copy")
    assert rows(tmp_path / "copy") == found
    assert len(asked) == len(cases)
    asked += [""] * 30
    other = replace(tiny_bundle.pipeline, provenance={"source": "another"})
    bundle.save(tmp_path / "other", other, tiny_bundle.floats)
    with pytest.raises(words.ExtremesError, match="source, output: the hardware differs"):
        rows(tmp_path / "other")
    assert worst_case_hardware.compare is not compare


def test_a_comparison_depends_on_the_hardware_and_on_the_worst_cases(tiny_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(words, "compare", lambda case, folder, lanes: 7)
    words.rows(tiny_folder / "bundle", tmp_path, store=tmp_path / "store", rtl=True, progress=False)
    entry = next((tmp_path / "store" / "worst-case").iterdir())
    symbols = json.loads((entry / "step.json").read_text())["symbols"]
    modules = {name.rpartition(".")[0] for name in symbols}
    assert {"fastac.gateware.mlp_mvm", "fastac.sim.check_stream"} <= modules
    assert {f"fastac.studies.robustness.{name}" for name in ("worst_case", "worst_case_solver")} <= modules
    assert "fastac.studies.robustness.drift" not in modules


def test_what_differs_is_counted(tiny_bundle, monkeypatch):
    frames = verify.special_frames(tiny_bundle.pipeline.background)[:2]
    assert extreme_frames.count_mismatches(tiny_bundle.pipeline, frames) == 0
    from fastac.models.emulator import direct

    loop = direct.loop

    def off(pipeline, chunk, out):
        loop(pipeline, chunk, out)
        out["depth_words"][0, :2, 0] += 1

    monkeypatch.setattr(direct, "loop", off)
    assert extreme_frames.count_mismatches(tiny_bundle.pipeline, frames) == 2


def test_no_build_folder(tmp_path):
    result = CliRunner().invoke(main, ["study", "extremes", str(tmp_path)])
    assert result.exit_code == 1
    assert result.output.startswith("Error: ")
    assert result.output.count("\n") == 1


def test_take_keeps_samples_together(tiny_data):
    chosen = samples.subset(tiny_data, np.array([5, 2]))
    assert len(chosen) == 2
    assert np.array_equal(chosen.frames, tiny_data.frames[[5, 2]])
    assert np.array_equal(chosen.indenter["x_mm"], tiny_data.indenter["x_mm"][[5, 2]])
    assert np.array_equal(chosen.background, tiny_data.background)
