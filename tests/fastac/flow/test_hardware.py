# amaranth: UnusedElaboratable=no
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from fastac.flow import hardware
from fastac.flow.hardware import HardwareError, check_verilog, lint, write_verilog
from fastac.gateware.target.device import XCZU19EG
from fastac.gateware.target.register_files.write import FILES
from fastac.gateware.top_zynq import TopZynq
from fastac.models.integer.bundle import Bundle
from fastac.models.random_bundle import random_bundle, scene
from fastac.sim.check_top import Report
from fastac.sim.runner import QUICK
from fastac.synth import fits
from fastac.synth.estimates.memories import block_rams, memories
from fastac.synth.estimates.resources import luts


@pytest.fixture(scope="module")
def bundle(tmp_path_factory) -> Bundle:
    folder = tmp_path_factory.mktemp("hardware") / "bundle"
    return random_bundle(folder, scene(("normals", "depth", "force_z"), mode="difference", lanes=2))


@pytest.fixture(scope="module")
def written(bundle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("written") / "verilog"
    write_verilog(bundle, folder, progress=False)
    return folder


def one_line(error: pytest.ExceptionInfo) -> str:
    text = str(error.value)
    assert len(text.splitlines()) == 1
    return text


def test_everything_that_vivado_and_a_driver_need_is_there(bundle, written):
    """And it is linted: see below what the linter finds."""
    assert {"fastac.v", "fastac.xdc", "build.tcl", "hardware.json"} <= {f.name for f in written.iterdir()}
    assert {f.name for f in (written / "registers").iterdir()} == set(FILES.values())
    assert not [file.name for file in written.iterdir() if file.name.startswith(".")]
    assert written.stat().st_mode & 0o777 == 0o755
    period = 1000 / bundle.scene.hardware.clock_mhz
    assert f"create_clock -name clk -period {period:.3f}" in (written / "fastac.xdc").read_text()
    assert re.search(r"^module fastac\(", (written / "fastac.v").read_text(), re.MULTILINE)

    content = json.loads((written / "hardware.json").read_text())
    assert content["top"] == "fastac"
    assert content["bundle_sha256"] == bundle.digest
    latency = content["latency_cycles_by_formula"]
    assert sum(latency["stage"].values()) == latency["first_pixel_to_force"]
    assert latency["initiation_interval"] == 16 * 16 // 2
    assert {"first_pixel_to_depth", "first_pixel_to_normals"} <= latency.keys()
    assert set(content["multipliers"]) == {"normals", "depth", "force"}
    registers = {register["name"]: register for register in content["registers"]}
    assert registers["FORCE_Z_LOW"]["offset"] == 0x60
    assert registers["ERRORS"]["access"] == "w1c"
    assert all(register["meaning"] for register in registers.values())
    assert (content["part"], content["streams"], content["force"]["axes"]) == (XCZU19EG.part, "video", ["z"])
    assert [output["name"] for output in content["outputs"]] == ["normals", "depth"]


@pytest.mark.parametrize(("frames", "arguments"), [(31, QUICK), (32, ())])
def test_the_simulator_of_a_short_run_is_built_without_optimisation(
    bundle, written, tmp_path, monkeypatch, frames, arguments
):
    """32 frames of 16×16 pixels are 8,192 pixels."""
    called = {}

    class Dataset:
        frames = np.repeat(bundle.pipeline.background[None], 40, axis=0)

    def simulate(*positional, **named):
        called.update(named)
        return Report(*[0] * 7)

    monkeypatch.setattr(hardware.simulation, "simulate", simulate)
    hardware.simulate(bundle, Dataset, np.arange(frames), written, tmp_path, progress=False)
    assert called["build_args"] == arguments


def test_more_multipliers_than_the_device_has_are_refused(bundle, tmp_path, monkeypatch):
    needed = sum(TopZynq(bundle).datapath.multipliers.values())
    monkeypatch.setattr(fits, "device_of", lambda scene: replace(XCZU19EG, dsps=needed - 1))
    monkeypatch.setattr(hardware, "to_rtlil", lambda top, name: pytest.fail("elaborated"))
    with pytest.raises(
        HardwareError, match=rf"{bundle.scene.name}: {needed} DSP48E2 \(normals \d+,"
    ) as error:
        write_verilog(bundle, tmp_path / "verilog", progress=False)
    assert "hardware.pixels_per_clock" in one_line(error)
    assert not list(tmp_path.iterdir())


def test_more_memory_than_the_device_has_is_refused(bundle, tmp_path, monkeypatch):
    needed = sum(block_rams(memories(bundle.pipeline)).values())
    assert needed > 0
    monkeypatch.setattr(fits, "device_of", lambda scene: replace(XCZU19EG, ramb36=needed - 0.5))
    with pytest.raises(
        HardwareError, match=rf"{bundle.scene.name}: {needed:g} RAMB36 \(background \d"
    ) as error:
        write_verilog(bundle, tmp_path / "verilog", progress=False)
    one_line(error)
    assert not list(tmp_path.iterdir())


def test_clearly_more_look_up_tables_than_the_device_has_are_refused(bundle, tmp_path, monkeypatch):
    """An estimate may be off by a quarter."""
    needed = sum(map(round, luts(bundle.pipeline).values()))
    monkeypatch.setattr(fits, "device_of", lambda scene: replace(XCZU19EG, lut=int(needed / 1.25) - 1))
    message = rf"{bundle.scene.name}: {needed:,} look-up tables by estimate \(control [\d,]+, .* has"
    with pytest.raises(HardwareError, match=message) as error:
        write_verilog(bundle, tmp_path / "verilog", progress=False)
    assert "hardware.pixels_per_clock" in one_line(error)
    assert not list(tmp_path.iterdir())


def test_verilog_of_another_bundle_is_refused(bundle, written, tmp_path):
    check_verilog(bundle, written)
    other = Bundle(bundle.pipeline, bundle.floats, "0" * 64)
    with pytest.raises(HardwareError, match=r"bundle_sha256 = .*: the bundle's is 0{16}…") as error:
        check_verilog(other, written)
    assert str(written) in one_line(error)
    # Before anything is simulated.
    with pytest.raises(HardwareError, match="bundle_sha256"):
        hardware.simulate(other, None, None, written, tmp_path / "sim", progress=False)
    assert not (tmp_path / "sim").exists()


@pytest.mark.parametrize(
    "content",
    [None, b"", b"{}", b"[]", b"3", b"\xff", b'{"bundle_sha256": 5}', b'{"bundle_sha256": null}'],
    ids=repr,
)
def test_a_folder_without_a_hash_is_refused(bundle, tmp_path, content):
    if content is not None:
        (tmp_path / "hardware.json").write_bytes(content)
    with pytest.raises(HardwareError) as error:
        check_verilog(bundle, tmp_path)
    assert str(tmp_path) in one_line(error)


@pytest.mark.parametrize("step", ["write_vivado_project", "write_json", "lint"])
@pytest.mark.parametrize("before", [False, True], ids=["first", "again"])
@pytest.mark.parametrize("reason", [KeyboardInterrupt(), OSError(28, "No space left on device")], ids=repr)
def test_interruption_leaves_the_old_folder_or_none(bundle, tmp_path, monkeypatch, step, before, reason):
    folder = tmp_path / "verilog"
    if before:
        folder.mkdir()
        (folder / "fastac.v").write_text("old")

    def interrupted(*args, **kwargs):
        raise reason

    monkeypatch.setattr(hardware, "to_rtlil", lambda top, name: "")
    monkeypatch.setattr(hardware, "verilog_of", lambda rtlil: "module fastac(clk);\nendmodule\n")
    monkeypatch.setattr(hardware, step, interrupted)
    with pytest.raises(type(reason)):
        write_verilog(bundle, folder, progress=False)
    assert [file.name for file in tmp_path.iterdir()] == ["verilog"] * before
    if before:
        assert [(file.name, file.read_text()) for file in folder.iterdir()] == [("fastac.v", "old")]


def test_writing_again_replaces_everything(bundle, tmp_path, monkeypatch):
    monkeypatch.setattr(hardware, "to_rtlil", lambda top, name: "")
    monkeypatch.setattr(hardware, "verilog_of", lambda rtlil: "module fastac(clk);\nendmodule\n")
    monkeypatch.setattr(hardware, "lint", lambda source: None)
    folder = tmp_path / "deeper" / "verilog"
    for _ in range(2):
        write_verilog(bundle, folder, progress=False)
        check_verilog(bundle, folder)
        assert not (folder / "stale.v").exists()
        (folder / "stale.v").write_text("")
    assert [file.name for file in folder.parent.iterdir()] == ["verilog"]


@pytest.mark.parametrize(
    ("body", "finding"),
    [
        ("wire [3:0] a = 4'd1; assign q = a[0] & missing;", "missing"),
        ("always @(posedge clk) q2 = 1;", "q2"),
        ("wire floating; assign q = floating;", "not driven.*floating"),
        ("wire loop; assign loop = ~loop; assign q = loop;", "loop"),
        ("latch l(.d(clk), .q(q));", "latch"),
    ],
    ids=["no such wire", "no such register", "no driver", "a combinational loop", "no such module"],
)
def test_lint_finds(tmp_path, body, finding):
    source = tmp_path / "fastac.v"
    source.write_text(f"module fastac(input clk, output q);\n{body}\nendmodule\n")
    with pytest.raises(HardwareError, match=rf"fastac.v: lint: %.*{finding}") as error:
        lint(source)
    one_line(error)


def test_lint_passes_what_is_right(tmp_path):
    source = tmp_path / "fastac.v"
    source.write_text("module fastac(input clk, output q);\nassign q = clk;\nendmodule\n")
    lint(source)
