"""The report on hand-made results of a simulation that did not take place."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from packet_hardware import packet_hardware
from vivado_texts import LITEX_TIMING, ULTRASCALE_UTILISATION

from fastac.gateware.target.device import XC7Z020
from fastac.models.integer import assemble
from fastac.models.integer.bundle import Bundle
from fastac.report import content as report_content
from fastac.report import page as report
from fastac.store.files import DamagedFileError
from fastac.synth import synthesis_figures, vivado_reports
from fastac.synth.estimates import energy

SIMULATED = {
    "frame_indices": [26, 33],
    "frames": 2,
    "values_compared": 123_456,
    "mismatches": 0,
    "first_mismatch": None,
    "values_by_output": {"force": 2, "depth": 392},
    "markers_compared": 789,
    "errors": 0,
    "latency_cycles": {"first_pixel_to_force": 3000, "last_pixel_to_force": 2700, "initiation_interval": 300},
}
HARDWARE = {
    "latency_cycles_by_formula": {"stage": {"normals": 40, "depth": 2000}, "initiation_interval": 300},
    "multipliers": {"normals": 100, "depth": 97},
}
ERRORS = {
    "float": {"gradient_mae_mm_per_px": 0.04, "depth_mae_mm": 0.02, "force_mae_n": 0.05, "force_r2": 0.9},
    "integer": {
        "gradient_mae_mm_per_px": 0.05,
        "depth_mae_mm": 0.021,
        "force_mae_n": 0.049,
        "force_r2": 0.89,
    },
    "growth_percent": {"gradient_mae_mm_per_px": 25.0, "depth_mae_mm": 5.0, "force_mae_n": -2.0},
    "saturated_values": {"gradient_saturated": 0, "displacement_saturated": 3},
}


def fill(folder: Path, simulated=SIMULATED, errors=ERRORS) -> Path:
    (folder / "verilog").mkdir(parents=True)
    (folder / "sim.json").write_text(json.dumps(simulated))
    (folder / "accuracy.json").write_text(json.dumps({"split": "test", "frames": 8, **errors}))
    (folder / "verilog" / "hardware.json").write_text(json.dumps(HARDWARE))
    return folder


@pytest.fixture
def content(tiny_bundle, tmp_path):
    return report_content.content(fill(tmp_path), tiny_bundle)


def rows(content) -> dict[str, tuple[str, str, str]]:
    found = report_content.summary_rows(content)
    assert len({row[0] for row in found}) == len(found)
    return {what: rest for what, *rest in found}


def test_neurons_that_pruning_kept(content):
    asked = ", ".join(["16"] * 3)
    assert rows(content)["neurons of the hidden layers"][0] == asked
    content["hidden_neurons"]["kept"] = [16, 13, 10]
    assert rows(content)["neurons of the hidden layers"][0] == f"{asked} asked, 16, 13, 10 kept"


def test_figures_of_vivado_beside_our_own(tiny_bundle, tmp_path):
    """They are those that vivado.json has for this bundle, each with its origin; else there are none."""
    folder = fill(tmp_path)
    plain = report_content.content(folder, tiny_bundle)
    assert "vivado" not in plain
    hardware = packet_hardware() | {"bundle_sha256": tiny_bundle.digest}
    for name, text in (("utilization.rpt", ULTRASCALE_UTILISATION), ("timing.rpt", LITEX_TIMING)):
        (folder / name).write_text(text)
    vivado_reports.write(vivado_reports.collect(folder, hardware, instance=None), folder)
    found = report_content.content(folder, tiny_bundle)
    assert found["vivado"]["figures"]["lut"] == {"value": 61234, "origin": "reported by Vivado"}
    assert found["resources"] == plain["resources"]
    shown = rows(found)["lut, Vivado"]
    assert shown[0] == "61234"
    assert shown[-1].startswith("reported by Vivado v.2023.2")


class TestContent:
    def test_latency_in_cycles_and_at_the_scene_s_clock(self, content):
        assert content["latency_cycles"]["first_pixel_to_force"] == 3000
        assert "Verilator" in content["latency_cycles"]["origin"]
        assert content["latency_ms"]["first_pixel_to_force"] == {
            "value": pytest.approx(0.02),  # 3000 cycles at 150 MHz
            "origin": "estimated: cycles / 150 MHz, the scene's assumed clock",
        }
        assert set(content["latency_ms"]) == {"first_pixel_to_force", "initiation_interval"}

    def test_the_scene_s_clock_counts(self, tiny_bundle, make_scene, tmp_path):
        scene = make_scene(hardware={"clock_mhz": 300.0})
        slower = replace(tiny_bundle, pipeline=tiny_bundle.pipeline.replace(scene=scene))
        found = report_content.content(fill(tmp_path), slower)
        assert found["latency_ms"]["first_pixel_to_force"]["value"] == pytest.approx(0.01)

    def test_what_was_compared_and_who_it_is(self, content, tiny_bundle):
        compared = content["rtl_vs_integer"]
        assert (compared["frames"], compared["values_compared"], compared["mismatches"]) == (2, 123_456, 0)
        assert content["bundle_sha256"] == tiny_bundle.digest
        assert content["data"]["test_frames"] == 8
        assert content["data"]["source"].startswith("simulated")
        assert content["frames_are"] == "simulated"
        assert content["accuracy"] == ERRORS

    def test_recorded_frames_are_called_so(self, tiny_bundle, make_scene, tmp_path):
        scene = make_scene(outputs=["depth"], sensor={"source": "recorded"})
        recorded = replace(tiny_bundle, pipeline=tiny_bundle.pipeline.replace(scene=scene))
        assert report_content.content(fill(tmp_path), recorded)["frames_are"] == "recorded photographs"

    def test_resources_say_that_they_are_estimates(self, content):
        assert content["resources"]["dsp48e2"]["value"] == 197
        for resource in content["resources"].values():
            assert resource["origin"].startswith("estimated: ")

    def test_the_part_is_the_scene_s(self, tiny_bundle, make_scene, tmp_path):
        scene = make_scene(hardware={"part": "xc7z020clg400-1"})
        small = replace(tiny_bundle, pipeline=tiny_bundle.pipeline.replace(scene=scene))
        found = report_content.content(fill(tmp_path), small)
        assert found["device"] == XC7Z020.totals
        resources = found["resources"]
        assert "dsp48e2" not in resources
        assert resources["dsp48e1"]["value"] == 197
        assert resources["dsp48e1"]["origin"].startswith("estimated: DSP48E1 of the architecture: one per")
        assert resources["dsp48e1_by_module"]["value"] == HARDWARE["multipliers"]
        assert rows(found)["dsp48e1"][0] == "197 (89.5%)"

    def test_energy_is_called_an_estimate(self, content, tiny_bundle):
        assert content["energy_estimate_uj_per_frame"] == {
            "value": pytest.approx(
                sum(w.total_pj for stage in energy.works(tiny_bundle.pipeline).values() for w in stage) * 1e-6
            ),
            "origin": energy.ORIGIN,
        }
        assert {"normals", "row_inverse", "force"} <= set(
            content["energy_estimate_uj_per_frame_by_stage"]["value"]
        )
        ours, _, origin = rows(content)["energy of a frame, estimate, µJ"]
        assert float(ours) > 0
        assert origin.startswith("estimated: ")

    def test_every_word_has_its_worst_case_and_width(self, content, tiny_bundle):
        found, pipeline = content["bounds"], tiny_bundle.pipeline
        assert found["fc0.accumulator"] == {
            "bound": pipeline.layers[0].accumulator_bound,
            "width_bits": pipeline.layers[0].accumulator_width,
        }
        assert found["slope"] == {
            "saturates_at": 4 - 2**-14,
            "width_bits": 17,
            "fraction_bits": 14,
        }
        last = pipeline.solver.stages[-1]
        assert found["row_inverse"] == {
            "bound_px": last.bound_px,
            "width_bits": last.format.width,
            "fraction_bits": last.format.fraction,
        }
        assert found["displacement"]["saturates_at_mm"] == pytest.approx(
            (2**16 - 1) * pipeline.displacement_mm_per_unit
        )
        assert found["force.accumulator"]["width_bits"] == pipeline.force.width
        for name, word in found.items():
            bound = word.get("bound", 0)
            assert bound < 2 ** (word["width_bits"] - 1), name

    def test_stages_that_are_absent_have_no_words(self, tiny_bundle, make_scene):
        trained = tiny_bundle.pipeline
        for outputs, absent in (
            (["normals"], {"source", "row_inverse", "displacement", "force.accumulator"}),
            (["depth"], {"displacement", "force.accumulator"}),
        ):
            pipeline = assemble.assemble(
                make_scene(outputs=outputs),
                layers=trained.layers,
                background=trained.background,
                rest_depth_mm=trained.rest_depth_mm,
            )
            assert not absent & set(report_content.bounds(Bundle(pipeline, {}, "0" * 64)))

    def test_is_strict_json(self, content):
        json.dumps(content, allow_nan=False)


class TestSummary:
    def test_rows(self, content):
        found = rows(content)
        assert found["RTL against integer model"][0] == "0 mismatches in 123,456 values, 2 frames"
        assert found["first pixel → force, cycles"][:2] == ["3,000", "about 163,500"]
        assert found["last pixel → force, cycles"][:2] == ["2,700", ""]
        assert found["a new frame every, cycles"][0] == "300"
        assert found["first pixel to force, ms"][:2] == ["0.0200", "1.09"]
        assert found["gradient_mae_mm_per_px, float → integer"] == [
            "0.04 → 0.05 (+25.00%)",
            "0.0456 → 0.0508",
            "simulated",
        ]
        assert found["force_mae_n, float → integer"][0] == "0.05 → 0.049 (-2.00%)"
        assert found["force_r2, float → integer"][:2] == ["0.9 → 0.89", ""]
        assert found["dsp48e2"][0] == "197 (10.0%)"
        assert found["dsp48e2"][2].startswith("estimated: ")

    def test_what_was_not_obtained_is_absent(self, tiny_bundle, tmp_path):
        errors = {**ERRORS, "float": {"depth_mae_mm": 0.02}, "integer": {"depth_mae_mm": 0.03}}
        simulated = {**SIMULATED, "latency_cycles": {"first_pixel_to_depth": 2500}}
        content = report_content.content(fill(tmp_path, simulated, errors), tiny_bundle)
        found = rows(content)
        assert found["first pixel → last depth, cycles"][:2] == ["2,500", ""]
        assert not [what for what in found if "force" in what or "gradient" in what]
        assert set(content["latency_ms"]) == {"first_pixel_to_depth"}

    def test_mismatches_are_not_hidden(self, tiny_bundle, tmp_path):
        content = report_content.content(fill(tmp_path, {**SIMULATED, "mismatches": 7}), tiny_bundle)
        assert rows(content)["RTL against integer model"][0].startswith("7 mismatches")


class TestPage:
    def test_has_the_figures_and_every_row(self, tiny_bundle, tiny_data, tmp_path):
        folder = fill(tmp_path)
        report.write(folder, tiny_bundle, tiny_data)
        stored = json.loads((folder / "report.json").read_text())
        page = (folder / "report.html").read_text()
        for what, ours, paper, origin in report_content.summary_rows(stored):
            for text in (what, ours, paper):
                assert text.replace("→", "→") in page
            assert origin.replace("'", "&#39;") in page
        for title in (
            "The reconstruction in three dimensions",
            "Where the cycles go",
            "Force on the held-out grid",
            "The frames that went",
            "Training",
        ):
            assert f"<h2>{title}" in page
        pictures = re.findall(r"data:image/png;base64,([A-Za-z0-9+/=]+)", page)
        assert len(pictures) == 5 + 2 * 6  # of the main frame; with the depth error of both frames
        assert all(base64.b64decode(p).startswith(b"\x89PNG") for p in pictures)
        assert page.count("<svg") == 1 + 5  # force; pixel network twice, force model, its last fits
        assert tiny_bundle.digest[:16] in page
        assert "row_inverse" in page
        by_stage = stored["energy_estimate_uj_per_frame_by_stage"]["value"]
        for name, uj in by_stage.items():
            assert f"<td>{name.replace('_', ' ')}</td><td>{uj:.4f}</td>" in page
        assert not re.search(r"https?://|src=\"(?!data:)", page)  # it must open without a network
        assert sorted(p.name for p in folder.iterdir()) == [
            "accuracy.json",
            "report.html",
            "report.json",
            "sim.json",
            "verilog",
        ]

    def test_it_leads_with_pictures_then_headlines_then_tables(self, tiny_bundle, tiny_data, tmp_path):
        report.write(fill(tmp_path), tiny_bundle, tiny_data)
        page = (tmp_path / "report.html").read_text()
        order = [
            "<h1>tiny</h1>",
            "<img ",
            'class="headlines"',
            "<canvas",
            'class="timeline"',
            "<svg",
            "<table>",
        ]
        places = [page.index(text) for text in order]
        assert places == sorted(places)
        assert "<b>0 mismatches</b>" in page
        assert "<b>3,000 cycles</b>" in page
        assert "<b>21 µm</b>" in page
        assert re.search(r"Frame (26|33), held out, .*; F_z found: \d\.\d+ N; true: 0\.060 N\.", page)

    def test_the_smallest_stage_has_its_name_and_its_number(self, tiny_bundle, tiny_data, tmp_path):
        folder = fill(tmp_path)
        stages = {"normals": 27, "gradients": 11, "source": 261, "solution_buffer": 1, "force": 33}
        hardware = HARDWARE | {"latency_cycles_by_formula": {"stage": stages}}
        (folder / "verilog" / "hardware.json").write_text(json.dumps(hardware))
        report.write(folder, tiny_bundle, tiny_data)
        page = (folder / "report.html").read_text()
        lines = page[page.index('<div class="timeline">') :].split("<h2>")[0]
        bar = r"<span>{}</span>\s*<span class=\"adds\"><i [^>]*></i><b>{}</b></span>\s*<div class=\"track\""
        for name, cycles in stages.items():
            assert re.search(bar.format(name.replace("_", " "), cycles), lines), name
        assert "the sum is 333 cycles" in page

    def test_without_force_there_is_no_force(self, tiny_bundle, tiny_data, make_scene, tmp_path):
        scene = make_scene(outputs=["normals"])
        trained = tiny_bundle.pipeline
        pipeline = assemble.assemble(
            scene, layers=trained.layers, background=trained.background, rest_depth_mm=trained.rest_depth_mm
        ).replace(provenance=trained.provenance)
        floats = {k: v for k, v in tiny_bundle.floats.items() if k.startswith("network.")}
        errors = {k: {} for k in ERRORS}
        simulated = {**SIMULATED, "latency_cycles": {"first_pixel_to_normals": 77}}
        folder = fill(tmp_path, simulated, errors)
        report.write(folder, Bundle(pipeline, floats, "0" * 64), tiny_data)
        page = (folder / "report.html").read_text()
        assert "Force" not in page
        assert "<canvas" not in page
        assert "first pixel → last normal, cycles" in page

    def test_results_that_are_missing_leave_no_report(self, tiny_bundle, tiny_data, tmp_path):
        folder = fill(tmp_path)
        (folder / "sim.json").unlink()
        with pytest.raises(FileNotFoundError, match=r"sim\.json"):
            report.write(folder, tiny_bundle, tiny_data)
        assert not (folder / "report.json").exists()


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("sim.json", {"frame_indices": "x"}, "frame_indices: Input should be a valid list"),
        (
            "sim.json",
            {"latency_cycles": {"initiation_interval": "long"}},
            "latency_cycles.initiation_interval: Input should be a valid integer",
        ),
        (
            "sim.json",
            {"latency_cycles": {"initiation_interval": {"1": 2}}},
            "latency_cycles.initiation_interval: Input should be a valid integer",
        ),
        ("accuracy.json", {"float": None}, "float: Input should be a valid dictionary"),
        ("accuracy.json", {"integer": {}}, "float and integer: "),
        ("verilog/hardware.json", {"multipliers": [1]}, "multipliers: Input should be a valid dictionary"),
        (
            "verilog/hardware.json",
            {"multipliers": {"fc1": 10**400}},
            "multipliers.fc1: Input should be less than or equal to",
        ),
    ],
)
def test_damaged_files_of_a_build(tiny_bundle, tmp_path, name, change, message):
    path = fill(tmp_path) / name
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(DamagedFileError) as caught:
        report_content.content(tmp_path, tiny_bundle)
    assert str(caught.value).startswith(f"{path}: {message}")
    path.write_text("[" * 100_000)
    with pytest.raises(DamagedFileError, match="damaged or no JSON"):
        report_content.content(tmp_path, tiny_bundle)


def test_counts_that_no_synthesis_gives(tmp_path):
    hashes = {"bundle_sha256": "a", "rtlil_sha256": "b"}
    totals = {"lut": {"value": 10**400, "origin": "counted"}}
    (tmp_path / "synth.json").write_text(json.dumps({**hashes, "totals": totals, "modules": {}}))
    with pytest.raises(DamagedFileError, match=r"synth\.json: totals\.lut\.value: Input should be"):
        synthesis_figures.resources(tmp_path, hashes)


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "9" * 5000, "{", '{"bundle_sha256": "another"}'])
def test_synthesis_of_something_else_is_left_out(tmp_path, text):
    (tmp_path / "synth.json").write_text(text)
    assert synthesis_figures.resources(tmp_path, {"bundle_sha256": "a", "rtlil_sha256": "b"}) == {}


def test_damaged_figures_of_synthesis(tmp_path):
    hashes = {"bundle_sha256": "a", "rtlil_sha256": "b"}
    for content in (
        {"totals": {"lut": 3}, "modules": {}},
        {"totals": {"dsp48e2": {"value": 1, "origin": "x"}}},
    ):
        (tmp_path / "synth.json").write_text(json.dumps(hashes | {"modules": {"a": {}}} | content))
        with pytest.raises(DamagedFileError, match=r"synth\.json: (totals\.lut: |damaged: KeyError)"):
            synthesis_figures.resources(tmp_path, hashes)
