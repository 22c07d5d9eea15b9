"""The parser on excerpts of genuine reports; of UltraScale+, hierarchy and power, on ones written by hand."""

import json

import pytest
from packet_hardware import packet_hardware
from vivado_texts import (
    HIERARCHY,
    LITEX_TIMING,
    LITEX_UTILISATION,
    PICORV32_TIMING,
    POWER,
    ULTRASCALE_UTILISATION,
)

from fastac.store.files import DamagedFileError
from fastac.synth import vivado_reports
from fastac.synth.vivado_reports import ReportError


def test_genuine_utilisation():
    assert vivado_reports.utilisation(LITEX_UTILISATION) == {
        "lut": 8297,
        "ff": 5434,
        "ramb36": 29.5,
        "dsp48e1": 4,
    }
    assert vivado_reports.heading(LITEX_UTILISATION, "Device") == "7a35ticsg324-1L"
    assert vivado_reports.heading(LITEX_UTILISATION, "Tool Version").startswith("Vivado v.2019.2")
    assert vivado_reports.heading(LITEX_UTILISATION, "Speed File") == ""


def test_genuine_timing():
    assert vivado_reports.timing(LITEX_TIMING) == {
        "setup_slack_ns": 0.248,
        "hold_slack_ns": 0.033,
        "failing_endpoints": 0,
        "clock_mhz": 100,
        "reachable_clock_mhz": pytest.approx(1000 / 9.752, abs=5e-4),
    }
    found = vivado_reports.timing(PICORV32_TIMING)
    assert (found["setup_slack_ns"], found["failing_endpoints"]) == (-3.463, 10)
    assert found["reachable_clock_mhz"] == pytest.approx(1000 / 8.463, abs=5e-4)


def test_ultrascale_hierarchy_and_power():
    found = vivado_reports.utilisation(ULTRASCALE_UTILISATION)
    assert found == {
        "lut": 61234,
        "ff": 80123,
        "carry8": 4321,
        "ramb36": 40.5,
        "uram288": 0,
        "dsp48e2": 662,
    }
    assert vivado_reports.hierarchical(HIERARCHY, "fastac_0") == {
        "lut": 55555,
        "ff": 70000,
        "uram288": 0,
        "dsp": 662,
        "ramb36": 36.5,
    }
    assert vivado_reports.hierarchical(HIERARCHY, "fastac_1") == {}
    assert vivado_reports.power(POWER) == {"total_w": 4.321, "dynamic_w": 3.3, "static_w": 1.021}
    assert vivado_reports.confidence(POWER) == "Medium"


@pytest.mark.parametrize("text", ["", "| a | b |\n", "\x00" * 40, LITEX_TIMING.replace("0.248", "NA")])
def test_no_figures_where_there_are_none(text):
    assert vivado_reports.utilisation(text) == {}
    assert vivado_reports.hierarchical(text, "fastac_0") == {}
    assert vivado_reports.power(text) == {}
    assert "setup_slack_ns" not in vivado_reports.timing(text)


@pytest.fixture
def reports(tmp_path):
    (tmp_path / "utilization.rpt").write_text(ULTRASCALE_UTILISATION)
    (tmp_path / "utilization_hierarchical.rpt").write_text(HIERARCHY)
    (tmp_path / "timing.rpt").write_text(LITEX_TIMING)
    (tmp_path / "power.rpt").write_text(POWER)
    return tmp_path


def test_collected_and_read_back(reports):
    hardware = packet_hardware()
    content = vivado_reports.collect(reports, hardware, instance="fastac_0")
    assert content["tool"].startswith("v.2023.2")
    assert content["power_confidence"] == "Medium"
    figures = content["figures"]
    assert figures["dsp48e2"] == {"value": 662, "origin": "reported by Vivado"}
    assert figures["core_lut"]["value"] == 55555
    assert figures["setup_slack_ns"]["value"] == 0.248
    assert figures["dynamic_w"]["value"] == 3.3
    path = vivado_reports.write(content, reports)
    assert vivado_reports.read(reports, hardware["bundle_sha256"]) == content
    # Of another bundle it is as if there were none.
    assert vivado_reports.read(reports, "0" * 64) == {}
    damaged = json.loads(path.read_text())
    damaged["figures"]["lut"]["value"] = "many"
    path.write_text(json.dumps(damaged))
    with pytest.raises(DamagedFileError, match=r"vivado.json: figures.lut.value: "):
        vivado_reports.read(reports, hardware["bundle_sha256"])


def test_out_of_context_there_is_no_instance(reports):
    content = vivado_reports.collect(reports, packet_hardware(), instance=None)
    assert not [name for name in content["figures"] if name.startswith("core_")]
    assert content["scope"] == "the core, out of context"


def test_a_report_that_is_absent_is_not_made_up(reports):
    (reports / "power.rpt").unlink()
    content = vivado_reports.collect(reports, packet_hardware(), instance=None)
    assert "total_w" not in content["figures"]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("timing.rpt", None, "timing.rpt: no such report: run build.tcl in Vivado first"),
        ("timing.rpt", "nothing", "timing.rpt: no figures were found in it"),
        ("utilization.rpt", "nothing", "utilization.rpt: no figures were found in it"),
        ("utilization.rpt", LITEX_UTILISATION, "Device 7a35ticsg324-1L: expected xczu19eg-ffvc1760-2-i"),
    ],
)
def test_refused(reports, name, text, message):
    if text is None:
        (reports / name).unlink()
    else:
        (reports / name).write_text(text)
    with pytest.raises(ReportError, match=message):
        vivado_reports.collect(reports, packet_hardware(), instance=None)
