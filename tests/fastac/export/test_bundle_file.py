"""What is written in one file: bytes that repeat, the card, and what of it a terminal is shown."""

import json
import shutil
import zipfile

import numpy as np
import pytest

from fastac.export.bundle_file import card_text, write_bundle_file
from fastac.export.card import card_of
from fastac.models import random_bundle
from fastac.models.integer import bundle as bundles
from fastac.models.integer.bundle import BundleError
from fastac.store.files import write_json

ERRORS = {"depth_mae_mm": 0.0123, "force_mae_n": 0.5}


@pytest.fixture(scope="module")
def random_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("card") / "b"
    random_bundle.random_bundle(folder, random_bundle.scene(("depth", "force_z")))
    return folder


def accuracy(folder, **changes) -> None:
    content = {"split": "test", "frames": 8, "float": ERRORS, "integer": ERRORS | {"depth_mae_mm": 0.02}}
    write_json(folder / "accuracy.json", content | {"growth_percent": {}, "saturated_values": {}} | changes)


@pytest.fixture
def build(tiny_folder, tmp_path):
    """A copy of the trained build, evaluated."""
    folder = shutil.copytree(tiny_folder, tmp_path / "build")
    accuracy(folder)
    return folder


def member(file, name: str) -> bytes:
    with zipfile.ZipFile(file) as archive:
        return archive.read(name)


def test_the_same_bundle_gives_the_same_bytes(random_folder, tmp_path):
    first, second = tmp_path / "a.fastac", tmp_path / "b.fastac"
    digest = write_bundle_file(random_folder, first, licence="MIT")
    assert digest == bundles.load(random_folder).digest
    write_bundle_file(shutil.copytree(random_folder, tmp_path / "copy"), second, licence="MIT")
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as archive:
        assert archive.namelist()[0] == "manifest.json"
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_single_file_can_be_written_again(random_folder, tmp_path):
    first, second, third = (tmp_path / f"{name}.fastac" for name in "abc")
    write_bundle_file(random_folder, first, licence="MIT")
    write_bundle_file(first, second)
    assert first.read_bytes() == second.read_bytes()
    write_bundle_file(first, third, licence="CC-BY-4.0 OR Apache-2.0")
    assert json.loads(member(third, "card.json"))["licence"] == "CC-BY-4.0 OR Apache-2.0"
    assert "CC-BY-4.0 OR Apache-2.0" in card_text(third)
    assert bundles.load(third).digest == bundles.load(first).digest


def test_the_card_of_a_build(build, tiny_data, tmp_path):
    file = tmp_path / "tiny.fastac"
    write_bundle_file(build, file)
    card = json.loads(member(file, "card.json"))
    bundle = bundles.load_bundle(build)
    assert card == card_of(build, bundle) == card_of(build / "bundle", bundle)
    assert card["licence"] == "not stated"
    assert card["outputs"] == {"normals": "1", "depth_mm": "mm", "force_n": "N"}
    assert card["sensor"] == {
        "geometry": "fingertip",
        "semi_axes_mm": [4.0, 5.0, 3.0],
        "height_px": 16,
        "width_px": 16,
        "pitch_mm": 0.25,
        "channels": ["B", "G", "R", "NIR"],
        "frames": "channels",
    }
    data = card["training_data"]
    assert data["frames_are"] == "simulated"
    assert data["source"] == tiny_data.source
    assert data["frames"] == len(tiny_data)
    splits = {split: len(tiny_data.indices(split)) for split in ("test", "train", "validation")}
    assert data.get("frames_of_split", splits) == splits
    assert card["errors"] == {
        "split": "test",
        "frames": 8,
        "float": ERRORS,
        "integer": ERRORS | {"depth_mae_mm": 0.02},
    }
    text = card_text(file)
    assert "16 × 16 px, pitch 0.25 mm" in text
    assert "On the 8 simulated frames of the split `test`" in text
    assert any(
        line.split("|")[1:-1] and "depth_mae_mm" in line and "0.02" in line for line in text.splitlines()
    )


def test_the_card_knows_the_dataset_beside_the_bundle(build, tiny_file):
    shutil.copy(tiny_file, build / "data.h5")
    data = card_of(build, bundles.load_bundle(build))["training_data"]
    assert data["frames_of_split"] == {"test": 8, "train": 18, "validation": 8}
    assert data["balls_mm"] == [1.5]


def test_errors_of_another_bundle_are_not_on_the_card(build):
    write_json(build / "report.json", {"bundle_sha256": "0" * 64})
    card = card_of(build, bundles.load_bundle(build))
    assert "errors" not in card
    write_json(build / "report.json", {"bundle_sha256": card["bundle_sha256"]})
    assert "errors" in card_of(build, bundles.load_bundle(build))


def test_a_card_cannot_steer_the_terminal(random_folder, tmp_path):
    folder = shutil.copytree(random_folder, tmp_path / "b")
    known = bundles.load(folder)
    hostile = known.pipeline.replace(provenance={"source": "x\x1b[2Jy\x07", "frames": 3})
    bundles.save(folder, hostile, known.floats)
    write_bundle_file(folder, tmp_path / "a.fastac")
    text = card_text(tmp_path / "a.fastac")
    assert "x[2Jy; 3 frames" in text
    assert "\x1b" not in text
    assert "\x07" not in text


@pytest.mark.parametrize("licence", ["", "MIT; rm", "a  b", "MIT AND", "x\ny"])
def test_licences_are_spdx_expressions(random_folder, tmp_path, licence):
    with pytest.raises(ValueError, match="expected an SPDX expression"):
        write_bundle_file(random_folder, tmp_path / "a.fastac", licence=licence)


def test_the_name_ends_as_it_must(random_folder, tmp_path):
    with pytest.raises(ValueError, match=r"a\.zip: a single-file bundle's name ends in \.fastac"):
        write_bundle_file(random_folder, tmp_path / "a.zip")


def test_what_does_not_load_is_not_written(random_folder, tmp_path):
    folder = shutil.copytree(random_folder, tmp_path / "b")
    with np.load(folder / "integers.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays["background"][0, 0] ^= 1
    np.savez_compressed(folder / "integers.npz", **arrays)
    with pytest.raises(BundleError, match="changed or damaged"):
        write_bundle_file(folder, tmp_path / "a.fastac")
    assert not (tmp_path / "a.fastac").exists()
