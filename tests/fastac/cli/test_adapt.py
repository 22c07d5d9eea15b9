"""A second unit of the tiny sensor: another light, coat, gel and camera."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from command_line import fail, run, succeed
from described_hardware import content

from fastac.flow import adapt
from fastac.flow.build import Build
from fastac.flow.hardware import NAME
from fastac.gateware.calibration import calibration_words
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.models.integer import quantise
from fastac.models.training import transfer
from fastac.sensor import dataset
from fastac.sensor.fingertip import generate
from fastac.studies.transfer.study import few

SECOND = {
    "light": {"ambient": 0.25, "below_mm": 9.0, "brightest_dn": 120.0},
    "elastomer": {"rim_mm": 0.5, "thickness_mm": 2.0, "modulus_mpa": 0.6},
    "electrons_per_dn": 5.0,
    "grain": 0.06,
}
PROTOCOL = {"seed": 7, "train_grid": 2, "validation_grid": 1, "test_grid": 1}


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(transfer, "STEPS", 100)
    monkeypatch.setattr(adapt, "FINETUNE_STEPS", 20)


@pytest.fixture(scope="module")
def second(make_scene, tmp_path_factory):
    """Ten frames of four presses to learn from, one more of them in split validation, and one of test."""
    path = tmp_path_factory.mktemp("second") / "second.h5"
    generate(make_scene(sensor=SECOND, protocol=PROTOCOL), path, progress=False, processes=1)
    return path


def test_a_bundle_and_a_calibration_for_hardware_that_is_built(tiny_folder, tiny_bundle, second, tmp_path):
    new = tmp_path / "new"
    arguments = ("adapt", tiny_folder, "--data", second, "-o", new, "--no-progress")
    printed = succeed(*arguments).stdout
    assert "presses: 5, tuned: " in printed
    assert "force: " in printed
    assert sorted(file.name for file in new.iterdir()) == ["adapt.json", "bundle", "calibration.bin"]
    found, data = bundles.load(new / "bundle"), dataset.read(second)
    assert found.scene == tiny_bundle.scene
    np.testing.assert_array_equal(found.pipeline.background, data.background)
    about = found.pipeline.provenance
    assert about["adapted_from_sha256"] == tiny_bundle.digest
    assert about["source"] == data.source
    assert f"adapted from the bundle {tiny_bundle.digest[:16]}…" in succeed("card", new).stdout
    assert json.loads((new / "adapt.json").read_text())["bundle_sha256"] == found.digest
    # The words are those of `fastac calibration`, and the bundle is one like any other.
    succeed("calibration", new, "--for", tiny_folder, "-o", tmp_path / "again.bin")
    assert (new / "calibration.bin").read_bytes() == (tmp_path / "again.bin").read_bytes()
    succeed("evaluate", new, "--data", second, "--no-progress")
    # What is there stays, unless told; finished steps are not performed again.
    assert fail(*arguments) == f"{new}: exists already; --force replaces it"
    again = run(*arguments, "--force")
    assert [line.split()[1] for line in again.stderr.splitlines()] == ["up"] * 4
    assert bundles.load(new / "bundle").digest == found.digest


def test_what_is_tuned_can_be_told(tiny_folder, second, tmp_path):
    told = ("--tune", "last", "--no-progress")
    printed = succeed("adapt", tiny_folder, "--data", second, "-o", tmp_path / "new", *told).stdout
    assert printed.startswith("presses: 5, tuned: last\n")
    arrays = [bundles.load(folder / "bundle").floats for folder in (tiny_folder, tmp_path / "new")]
    for name in ("network.0.weight", "network.3.weight"):
        assert np.array_equal(*(array[name] for array in arrays)) == (name == "network.0.weight")


def test_a_single_press_changes_the_background_alone(tiny_folder, tiny_bundle, second, tmp_path):
    """Unless told otherwise, for which it is enough to tune gains."""
    data = dataset.read(second)
    few(second, data, 1, 1, tmp_path / "one.h5")
    arguments = ("adapt", tiny_folder, "--data", tmp_path / "one.h5", "--no-progress")
    assert succeed(*arguments, "-o", tmp_path / "new").stdout.startswith("presses: 1, tuned: none\n")
    found, known = bundles.load(tmp_path / "new" / "bundle"), tiny_bundle.pipeline
    np.testing.assert_array_equal(found.pipeline.background, data.background)
    arrays = (quantise.layers_to_arrays(pipeline.layers) for pipeline in (found.pipeline, known))
    np.testing.assert_equal(*arrays)
    told = succeed(*arguments, "--tune", "gains", "-o", tmp_path / "told").stdout
    assert told.startswith("presses: 1, tuned: gains\n")
    told = bundles.load(tmp_path / "told" / "bundle").pipeline
    assert (told.layers[0].weight != known.layers[0].weight).any()


def test_what_cannot_be_loaded_is_refused_before_anything_is_trained(
    tiny_folder, tiny_bundle, make_scene, second, tmp_path
):
    baked = make_scene(hardware={"weights": "baked"})
    layers = tuple(replace(layer, loadable=False) for layer in tiny_bundle.pipeline.layers)
    bundles.save(
        tmp_path / "baked", tiny_bundle.pipeline.replace(scene=baked, layers=layers), tiny_bundle.floats
    )
    message = fail("adapt", tmp_path / "baked", "--data", second, "-o", tmp_path / "new", "--no-progress")
    assert message == "hardware.weights: baked, the hardware takes no calibration"
    message = fail("adapt", tiny_folder, "--data", second, "-o", tiny_folder, "--force")
    assert message == f"{tiny_folder}: is BUNDLE; give another folder"
    assert not (tmp_path / "new").exists()
    assert not (tmp_path / "store").exists()


@pytest.mark.full
def test_a_scene_without_a_force(make_scene, tiny_file, second, tmp_path):
    scene = make_scene(outputs=["normals", "depth"])
    old, new = tmp_path / "old", tmp_path / "new"
    Build(scene, old, tiny_file, progress=False).run(lambda *_: None, until="bundle")
    printed = succeed("adapt", old, "--data", second, "-o", new, "--no-progress").stdout
    assert "force: none" in printed
    known, found = (bundles.load(folder / "bundle") for folder in (old, new))
    words = np.fromfile(new / "calibration.bin", "<u4")
    np.testing.assert_array_equal(words, calibration_words(found, known))
    assert found.digest != known.digest


@pytest.mark.full
@pytest.mark.long
def test_built_hardware_computes_the_new_integers(make_scene, tiny_file, second, tmp_path):
    """Verilog of the first unit's bundle, with calibration and background of the second unit."""
    scene = make_scene(
        outputs=["depth", "force_z"],
        network={"width": 4},
        poisson={"mode": "difference", "solver": "tridiagonal"},
        force={"kernel": "collapsed"},
    )
    old, new = tmp_path / "old", tmp_path / "new"
    Build(scene, old, tiny_file, progress=False).run(lambda *_: None, until="bundle")
    succeed("adapt", old, "--data", second, "-o", new, "--no-progress")
    first, found = (bundles.load(folder / "bundle") for folder in (old, new))
    place = tmp_path / "verilog"
    place.mkdir()
    (place / f"{NAME}.v").write_text(to_verilog(TopZynq(first), name=NAME))
    (place / "hardware.json").write_text(json.dumps(content(found)))
    succeed(
        *("run", new, "--via", "sim", "--verilog", place, "--source", second, "--split", "all"),
        *("--calibration", new / "calibration.bin", "--capture-background"),
        *("--hdf5", tmp_path / "found.h5", "--no-progress"),
    )
    frames = dataset.read(second).frames
    expected, before = (Emulator(bundle.pipeline).run(frames) for bundle in (found, first))
    assert (expected.depth_words != before.depth_words).any()
    with h5py.File(tmp_path / "found.h5") as file:
        np.testing.assert_array_equal(
            np.rint(file["force_z_n"] / found.pipeline.force_n_per_unit), expected.force_raw[:, 0]
        )
        depth = file["depth_mm"][:] / found.pipeline.depth_mm_per_unit
        np.testing.assert_array_equal(np.rint(depth), expected.depth_words)
        np.testing.assert_array_equal(file["validity"], expected.validity)
