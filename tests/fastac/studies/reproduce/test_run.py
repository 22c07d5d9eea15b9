# amaranth: UnusedElaboratable=no
"""The whole reproduction on a small virtual rig; only what the RTL counts is taken from its formulas."""

import importlib
import json
import os
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import fastac
from fastac.cli.main import main
from fastac.flow import hardware, training
from fastac.flow.build import Build
from fastac.gateware.cycle_model import cycles
from fastac.models.accuracy import compare_pipelines
from fastac.report.paper import FORCE_MAE_N, STAGES
from fastac.report.tables import Table
from fastac.scenes import schema as scenes
from fastac.store.closure import Code
from fastac.store.files import write_json
from fastac.store.store import Store, open_store
from fastac.studies.demos import grasp, vibration
from fastac.studies.reproduce import limits_geometry, run
from fastac.studies.reproduce.section import Finished, Section, vertical

pytestmark = pytest.mark.long
RIG = """
name = "rig"
outputs = ["depth", "force_xyz"]
[sensor]
geometry = "fingertip"
height_px = 32
width_px = 32
pitch_mm = 0.25
ellipsoid = { semi_axes_mm = [8.0, 9.0, 4.0] }
elastomer = { mechanics = "fem", friction = 1.0, elements = 8, layers = 1, rim_mm = 0.5, thickness_mm = 2.0 }
markers = { spacing_mm = 1.8, radius_mm = 0.4 }
light = { specular = 0.1 }
[protocol]
train_grid = 2
validation_grid = 1
test_grid = 1
loads_n = [0.1, 0.15, 0.2]
tangential_shares = [0.4]
ball_mm = 2.5
[poisson]
solver = "tridiagonal"
[force]
kernel = "collapsed"
kernel_size = 3
hidden = 4
[hardware]
weights = "baked"
[training]
normals_epochs = 3
normals_batch_px = 1024
finetune_epochs = 1
force_epochs = 2
"""
SAMPLES = {"train": 60, "validation": 15, "test": 15}


def elaborated(bundle, folder, *, progress):
    folder.mkdir()
    write_json(folder / "hardware.json", hardware.describe(hardware.TopZynq(bundle), rtlil=""))


def simulated(bundle, data, index, verilog_folder, folder, *, progress):
    found = {"frames": len(index), "values_compared": 2709, "mismatches": 0, "markers_compared": 1}
    return {**found, "latency_cycles": cycles(bundle.scene), "values_by_output": {}, "errors": 0}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the scene's file, the build and the reproduction, and what the command printed."""
    folder = tmp_path_factory.mktemp("reproduce")
    (folder / "rig.toml").write_text(RIG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: 1)  # a few presses are not worth worker processes
        patch.setattr(hardware, "write_verilog", elaborated)
        patch.setattr(hardware, "simulate", simulated)
        patch.setattr(vibration, "Vibration", partial(vibration.Vibration, seconds=0.2))
        patch.setattr(grasp, "Grasp", partial(grasp.Grasp, push_s=0.1, pause_s=0.05))
        result = invoke(folder)
    assert result.exit_code == 0, result.output
    return folder, result


def invoke(folder, *options):
    arguments = ["reproduce", folder / "rig.toml", "--build", folder / "build" / "rig", "-o", folder / "out"]
    return CliRunner().invoke(main, [*map(str, arguments), "--no-progress", *options])


@pytest.fixture(scope="module")
def build(place):
    folder = place[0]
    return Build(scenes.load(folder / "rig.toml"), folder / "build" / "rig", progress=False)


@pytest.fixture(scope="module")
def content(place):
    return json.loads((place[0] / "out" / "reproduce.json").read_text())


@pytest.mark.full
def test_everything_is_there_and_called_simulated(place, content):
    folder, result = place
    assert list(content["sections"]) == ["geometry", "forces", "stages", "limits", "vibration", "grasp"]
    assert (content["frames_are"], content["samples"], content["absent"]) == ("simulated", SAMPLES, {})
    page = (folder / "out" / "reproduce.html").read_text()
    assert page.count("data:image/png;base64,") == 6
    assert 'src="http' not in page
    for name, section in run.SECTIONS.items():
        assert section.title in page
        for table in section.tables(content["sections"][name]):
            assert table.text in result.output
            assert table.title in page
    assert "ours: simulated frames" in page
    assert result.output.count("reached") >= len(content["goals"])


@pytest.mark.full
def test_gradients_and_depth_are_those_of_the_build_s_evaluation(build, content):
    geometry = content["sections"]["geometry"]
    index = vertical(build.data, "test")
    assert geometry["frames"] == len(index) == 3
    errors = compare_pipelines(build.bundle, build.data, index, progress=False)[0]["float"]
    nir = geometry["channels"]["bgr+nir"]
    assert nir["gradient_mae_mm_per_px"]["total"] == pytest.approx(errors["gradient_mae_mm_per_px"])
    assert nir["depth_mae_mm"]["prior"] == pytest.approx(errors["depth_mae_mm"])
    rgb = geometry["channels"]["bgr"]["gradient_mae_mm_per_px"]
    assert rgb["total"] == pytest.approx(rgb["x"] + rgb["y"])
    ratio = nir["gradient_mae_mm_per_px"]["total"] / rgb["total"]
    assert geometry["gradient_reduction_percent"]["total"] == pytest.approx(100 * (1 - ratio))
    depth = nir["depth_mae_mm"]
    assert depth["no_prior"] > depth["no_prior_less_mean"] > depth["prior"]


@pytest.mark.full
def test_forces_are_those_of_the_ablation_and_of_the_evaluation(place, build, content):
    forces = content["sections"]["forces"]
    assert set(forces["displacements"]) == {"true", "found"}
    written = json.loads((place[0] / "out" / "forces" / "force_ablation.json").read_text())
    assert {key: forces[key] for key in written} == written
    errors = json.loads((build.folder / "accuracy.json").read_text())
    for name in ("float", "integer"):
        for axis, mae in zip("xyz", forces["build"][name]["mae_n"], strict=True):
            assert mae == pytest.approx(errors[name][f"force_{axis}_mae_n"])
    assert "0.0545" in place[1].output
    assert list(written["displacements"]["true"]["results"]) == [" ".join(pair) for pair in FORCE_MAE_N]


@pytest.mark.full
def test_stages_have_times_cycles_and_no_invented_energy(build, content):
    stages = content["sections"]["stages"]
    cpu, rtl = stages["platforms"]["CPU"], stages["platforms"]["RTL"]
    assert set(cpu["latency_ms"]) == set(rtl["latency_ms"]) == set(STAGES)
    assert all(value > 0 for value in cpu["latency_ms"].values())
    known = cycles(build.scene)
    assert rtl["latency_cycles"]["image_to_force"] == known["first_pixel_to_force"]
    assert rtl["latency_ms"]["depth"] == pytest.approx(known["stage"]["depth"] / 150e3)
    assert rtl["energy_origin"].startswith("estimated: ")
    for what in ("energy of the CPU", "GPU"):
        platform, key = ("CPU", "energy_mj") if "energy" in what else ("GPU", "latency_ms")
        assert (what in stages["absent"]) != (key in stages["platforms"].get(platform, {}))
    errors = json.loads((build.folder / "accuracy.json").read_text())
    assert rtl["accuracy"]["force"] == errors["integer"]["force_z_mae_n"]
    assert cpu["accuracy"]["depth"] == errors["float"]["depth_mae_mm"]


@pytest.mark.full
def test_limits_switch_off_one_thing_each(build, content):
    limits = content["sections"]["limits"]
    names = ["as recorded", "no camera noise", "no grain of the paint", "no dots"]
    names += ["no gloss, no cast shadows", "none of these", "as recorded, a network twice as wide"]
    assert list(limits["networks"]) == names
    assert [name for name, found in limits["networks"].items() if "bgr" in found] == list(
        limits_geometry.WITH_RGB
    )
    assert set(limits["regions"]) == {"under dots", "in contact", "elsewhere"}
    for key in ("pixels_percent", "error_percent"):
        assert sum(part[key] for part in limits["regions"].values()) == pytest.approx(100)
    total = content["sections"]["geometry"]["channels"]["bgr+nir"]["gradient_mae_mm_per_px"]["total"]
    weighted = sum(p["pixels_percent"] * p["gradient_mae_mm_per_px"] for p in limits["regions"].values())
    assert weighted / 100 == pytest.approx(total, rel=1e-5)
    # From true normals only the discretisation is left, in whichever mode.
    prior = content["sections"]["geometry"]["channels"]["bgr+nir"]["depth_mae_mm"]["prior"]
    assert max(limits["solver_depth_mae_mm"].values()) < prior
    force = limits["force"]
    assert len(force) == 8
    assert "true, without the largest load" in force
    assert all(np.isfinite(errors["mae_n"]).all() for errors in force.values())


@pytest.mark.full
def test_goals_follow_from_the_sections(content):
    goals = {goal["what"]: goal for goal in content["goals"]}
    assert len(goals) == 8
    for goal in goals.values():
        bound = goal.get("at_most", goal.get("at_least"))
        assert goal["reached"] == (goal["ours"] <= bound if "at_most" in goal else goal["ours"] >= bound)
    assert goals["gradient MAE, RGB-NIR"]["at_most"] == 0.0068
    assert goals["depth MAE with prior"]["at_most"] == 0.0208
    full = content["sections"]["forces"]["displacements"]["found"]["results"]["dynamic xyz"]
    assert [goals[f"F_{axis}, NMAE"]["ours"] for axis in "xyz"] == full["nmae_percent"]


@pytest.mark.full
def test_a_second_run_keeps_everything(place, monkeypatch):
    folder, first = place

    def again(*_, **__):
        raise AssertionError("done again")

    for module, name in ((training, "normals"), (hardware, "simulate"), (limits_geometry, "seen_by")):
        monkeypatch.setattr(module, name, again)
    result = invoke(folder)
    assert result.stdout == first.stdout
    assert "running" not in result.stderr


def networks(build: Build) -> dict:
    """The trainings of the section `limits`, by experiment and channels."""
    bundle, data = (Path(build.folder / name) for name in ("bundle", "data.h5"))
    finished = Finished.read(build.scene, bundle, data, store=build.store, progress=False)
    known = {"store": finished.store, "progress": False}
    return limits_geometry.network_steps(finished.scene, finished.data_path, **known)


@pytest.mark.full
def test_an_interrupted_section_goes_on_with_what_it_has(place, build, monkeypatch):
    folder, store = place[0], open_store(build.store)
    before = (folder / "out" / "limits" / "limits.json").read_text()
    shutil.rmtree(store.folder / "limits")
    gone = store.perform(networks(build)["no dots"]["bgr+nir"])
    errors = gone.path("errors.json").read_text()
    shutil.rmtree(gone.folder)
    drawn = []
    draw = limits_geometry.seen_by

    def seen_by(*arguments, **keys):
        drawn.append(keys["label"])
        return draw(*arguments, **keys)

    monkeypatch.setattr(limits_geometry, "seen_by", seen_by)
    result = invoke(folder)
    assert result.exit_code == 0, result.output
    assert drawn == ["frames, no dots"]
    assert (folder / "out" / "limits" / "limits.json").read_text() == before
    again = store.perform(networks(build)["no dots"]["bgr+nir"])
    assert again.path("errors.json").read_text() == errors


@pytest.mark.full
def test_a_section_depends_on_what_it_reads(build):
    """A training on its own settings, the hardware's left out; only the times on the build's report."""
    wider = networks(build)["as recorded, a network twice as wide"]["bgr+nir"]
    store = open_store(build.store)
    assert store.is_current(wider)
    scene = wider.arguments["trained"]
    other = scene.model_copy(update={"network": scene.network.model_copy(update={"width": 5})})
    changed = replace(wider, arguments={**wider.arguments, "trained": other})
    assert store.why(changed).startswith("trained network")
    lanes = scene.hardware.model_copy(update={"pixels_per_clock": 2})
    unread = scene.model_copy(update={"hardware": lanes})
    assert store.is_current(replace(wider, arguments={**wider.arguments, "trained": unread}))
    reads = {name: set(step.arguments) for name, step in run.steps(build, run.SECTIONS).items()}
    assert [name for name, read in reads.items() if "report" in read] == ["stages"]
    assert reads["limits"] == {"scene", "bundle", "data", "geometry"}


OWN = """
import shutil
from pathlib import Path
from fastac.studies.reproduce.section import Finished
from fastac.store.files import write_json


def ran(folder, scene, bundle, data, *, store, progress):
    build = Finished.read(scene, bundle, data, store=store, progress=progress)
    (folder / "own.png").write_bytes(Path(__file__).with_name("picture.png").read_bytes())
    write_json(folder / "own.json", {"scene": build.scene.name})
"""


@pytest.mark.full
def test_a_section_of_one_s_own(place, build, tmp_path, monkeypatch):
    """As the temporal experiments add theirs: a function, its tables, and its picture."""
    package = tmp_path / "own_sections"
    package.mkdir()
    (package / "__init__.py").write_text(OWN)
    shutil.copy(place[0] / "out" / "stages" / "stages.png", package / "picture.png")
    monkeypatch.syspath_prepend(tmp_path)
    ran = importlib.import_module("own_sections").ran
    roots = {"fastac": Path(fastac.__file__).parent, "own_sections": package}
    monkeypatch.setattr(run, "open_store", lambda folder: Store(folder, Code(roots)))

    own = Section("A section", ran, lambda found: [Table("T", ["a"], [[found["scene"]]])], ("own.png",))
    without = Section("Absent one", ran, lambda found: [], (), lacks=lambda _: "no such thing")
    sections = {"own": own, "none": without}
    states = []
    for _ in range(2):
        found = run.run(build, tmp_path / "out", lambda name, state: states.append((name, state)), sections)
    assert [state for name, state in states if name == "own"] == ["running", "kept"]
    assert found["sections"] == {"own": {"scene": "rig"}}
    assert found["absent"] == {"none": "no such thing"}
    assert found["goals"] == []
    page = (tmp_path / "out" / "reproduce.html").read_text()
    assert page.count("data:image/png") == 1
    assert "Absent: no such thing." in page


def lacking(build) -> dict[str, str | None]:
    return {name: section.lacks(build) for name, section in run.SECTIONS.items()}


def test_what_a_scene_has_no_use_for_is_said(make_scene, tiny_file, tiny_folder):
    found = lacking(Build(make_scene(), tiny_folder, tiny_file, progress=False))
    assert found["geometry"] is found["stages"] is found["limits"] is None
    assert found["forces"].startswith("sensor.markers: missing")
    found = lacking(Build(make_scene(outputs=["normals"]), tiny_folder, tiny_file, progress=False))
    assert found["geometry"] == "outputs = normals: no depth is found from normals"
    assert found["stages"].startswith("outputs = normals: not all of")
    assert found["forces"] == "outputs = normals: no force is wanted"


def test_a_missing_scene_is_one_line(tmp_path):
    result = CliRunner().invoke(main, ["reproduce", str(tmp_path / "none.toml"), "--no-progress"])
    assert result.exit_code == 1
    assert "none.toml" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
