import json
import subprocess
import sys
from pathlib import Path

import pytest

from fastac.report.scope import ABSENT, Scope, table
from fastac.scenes.schema import load
from fastac.store.record import RECORD
from fastac.synth.estimates.stages import stage_names

SCENES = Path(__file__).parents[3] / "scenes"


def scope(make_scene, tmp_path, **changes):
    return Scope(make_scene(**changes), tmp_path)


def absent(found: dict[str, str]) -> set[str]:
    return {name for name, text in found.items() if text.startswith(ABSENT)}


def test_depth_and_force(make_scene, tmp_path):
    found = scope(make_scene, tmp_path)
    assert absent(found.simulated()) == {"demosaicing"}
    assert absent(found.elaborated()) == {"recurrences", "reversal", "bridge", "dots", "slip"}
    compared = {"normals": "768", "depth": "196", "force": "1", "slip": ABSENT, "force map": ABSENT}
    assert found.verified() == compared
    assert found.trained()["force model"] == "kernels 5×5"


def test_a_force_of_weights_and_dots(make_scene, tmp_path):
    force = {"kernel": "collapsed", "clamp": False, "fit": "weights"}
    found = scope(make_scene, tmp_path, force=force)
    assert found.trained()["force model"] == "weights of the displacement"
    markers = {"spacing_mm": 1.0, "radius_mm": 0.2}
    found = scope(make_scene, tmp_path, force=force | {"dots": True}, sensor={"markers": markers})
    assert found.trained()["force model"] == "weights of the displacement and of the dots' shifts"
    changes = {"outputs": ["force_z", "slip"], "sensor": {"markers": markers}}
    found = scope(make_scene, tmp_path, force=force | {"dots": True}, **changes)
    assert found.verified()["slip"] == "2"
    assert int(found.elaborated()["slip"].replace(",", "")) > 500


def test_force_without_depth(make_scene, tmp_path):
    changes = {"outputs": ["force_xyz"], "poisson": {"solver": "adjoint"}}
    found = scope(make_scene, tmp_path, force={"clamp": False, "fit": "slopes"}, **changes)
    assert "labels: depth" in absent(found.simulated())
    kept = {"control", "background", "normals", "gradients", "force"}
    assert absent(found.elaborated()) == set(stage_names()) - kept
    assert found.trained()["force model"] == "weights of the slopes"
    saved = {name: text.split(": ")[1] for name, text in found.area().items()}
    assert all(text.startswith("-") for text in saved.values())


def test_normals_alone(make_scene, tmp_path):
    found = scope(make_scene, tmp_path, outputs=["normals"])
    assert found.trained()["force model"] == ABSENT
    assert absent(found.elaborated()) == set(stage_names()) - {"control", "background", "normals"}
    assert found.seconds()["force model"] == ABSENT
    assert found.seconds()["presses"] == "not built"


def test_wall_times_are_those_of_the_build(make_scene, tmp_path):
    (tmp_path / RECORD).write_text(json.dumps({"normals": {"entry": "normals/1-2", "seconds": 12.4}}))
    found = scope(make_scene, tmp_path).seconds()
    assert found["pixel network, float"] == "12 s"
    assert found["presses"] == "not built"


def test_everything_has_all_there_is(make_scene, tmp_path):
    found = scope(make_scene, tmp_path, outputs=["normals"])
    assert set(found.everything.outputs) == {"normals", "depth", "force_xyz", "force_map"}
    assert found.everything.sensor == found.scene.sensor


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_scene_has_one_with_everything(path, tmp_path):
    scene = Scope(load(path), tmp_path).everything
    assert {"normals", "depth", "force_xyz", "force_map"} == set(scene.outputs)


def test_a_stage_that_one_scene_alone_has(make_scene, tmp_path):
    smoothed = scope(make_scene, tmp_path, name="smoothed", network={"smoothing_px": 4}, outputs=["normals"])
    assert list(smoothed.elaborated())[-1] == "smoothing"
    for columns in ([scope(make_scene, tmp_path), smoothed], [smoothed, scope(make_scene, tmp_path)]):
        [row] = [line for line in table(columns).splitlines() if line.startswith("| smoothing")]
        cells = [cell.strip() for cell in row.split("|")[2:4]]
        assert sorted(cell == ABSENT for cell in cells) == [False, True]
        assert cells[columns.index(smoothed)] == smoothed.elaborated()["smoothing"]


def test_a_column_for_each_scene(make_scene, tmp_path):
    lines = table(
        [scope(make_scene, tmp_path), scope(make_scene, tmp_path, name="two", outputs=["normals"])]
    ).splitlines()
    assert lines[0].replace(" ", "") == "||tiny|two|"
    assert {line.count("|") for line in lines if line.startswith("|")} == {4}
    assert sum("estimated: " in line for line in lines) == 4


def test_the_command_loads_only_what_it_needs(tiny_toml, tmp_path):
    """A table of formulas must not wait for libraries that it has no use for."""
    path = tmp_path / "tiny.toml"
    path.write_text(tiny_toml)
    code = f"""
import sys
from fastac.cli.main import main
main(["scope", {str(path)!r}], standalone_mode=False)
print(*sorted({{"h5py", "matplotlib", "numba", "scipy", "torch"}} & sys.modules.keys()), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.split() == []
    assert "fits, and takes of the part" in done.stdout
