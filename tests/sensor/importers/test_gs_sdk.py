import json
from functools import partial

import numpy as np
import pytest
from miniatures import GS_SDK_PRESSES, gs_sdk_folder, refused_by
from PIL import Image

from fastac.sensor.dataset import read
from fastac.sensor.importers.gs_sdk import import_folder

PRESSES = GS_SDK_PRESSES


@pytest.fixture
def folder(tmp_path):
    return gs_sdk_folder(tmp_path / "calib")


def imported(folder, **changed):
    output = folder.parent / "out.h5"
    given = {"px_per_mm": 10.0, "height_px": 32, "width_px": 32, "progress": False}
    import_folder(folder, output=output, **given | changed)
    return read(output)


refused = partial(refused_by, imported)


def test_presses_of_several_balls(folder):
    data = imported(folder)
    assert data.pitch_mm == pytest.approx(0.2)
    np.testing.assert_array_equal(data.group, [*PRESSES, "background"])
    np.testing.assert_array_equal(data.indenter["ball_mm"], [4, 4, 6.5, np.nan])
    np.testing.assert_allclose(data.indenter["center_px"][1], [(31.5 - 32) / 2 + 15.5, (25 - 24) / 2 + 15.5])
    np.testing.assert_array_equal(data.indenter["radius_px"][:3], 6)
    np.testing.assert_array_equal(data.frames[:3, 16, 16, 0], [50, 51, 52])  # blue: 50, 51, 52
    np.testing.assert_array_equal(data.split, ["train"] * 4)
    # The same circle of a larger ball is flatter.
    tilt = [data.normals[k, ..., 2][data.valid[k]].min() for k in range(3)]
    assert tilt[2] > tilt[0]


def test_the_split_that_the_folder_has(folder):
    parts = {"train": ["4.000mm/0", "6.500mm\\0"], "test": ["4.000mm/1"]}
    (folder / "train_test_split.json").write_text(json.dumps(parts))
    np.testing.assert_array_equal(imported(folder).split, ["train", "test", "train", "train"])
    (folder.parent / "out.h5").unlink()
    (folder / "train_test_split.json").write_text(json.dumps({"train": ["4.000mm/0"], "test": []}))
    assert "'4.000mm/1': in neither train nor test" in refused(folder)
    (folder / "train_test_split.json").write_text(json.dumps({"train": ["4.000mm/0"]}))
    assert "train_test_split.json: test: expected a list of folders" in refused(folder)
    (folder / "train_test_split.json").write_text(json.dumps({"train": [*PRESSES], "test": [*PRESSES]}))
    assert "'4.000mm/0': both in train and in test" in refused(folder)
    (folder / "train_test_split.json").write_text("{")
    assert "train_test_split.json: damaged or no JSON" in refused(folder)


def test_presses_without_a_circle(folder):
    (folder / "4.000mm/1/label.npz").unlink()
    assert "label.npz: no such file: the press has no circle (--skip-unlabelled)" in refused(folder)
    data = imported(folder, skip_unlabelled=True)
    assert (len(data), data.left_out) == (3, 1)
    (folder.parent / "out.h5").unlink()
    for name in PRESSES:
        (folder / name / "label.npz").unlink(missing_ok=True)
    assert "none of 3 presses is labelled" in refused(folder, skip_unlabelled=True)


def test_bad_labels(folder):
    label = folder / "4.000mm/0/label.npz"
    np.savez(label, center=[1, 2, 3], radius=12)
    assert "label.npz: center = int64 of shape (3,): expected two numbers" in refused(folder)
    np.savez(label, center=[1, 2])
    assert "label.npz: radius: missing array" in refused(folder)
    np.savez(label, center=np.array([{}, 1]), radius=12)
    assert "label.npz: damaged or no .npz file" in refused(folder)
    np.savez(label, center=[30, 24], radius=30)
    assert "label.npz: radius_px = 30: 3.000 mm" in refused(folder)
    label.write_bytes(b"PK\x03\x04")
    assert "label.npz: damaged or no .npz file" in refused(folder)


def test_bad_catalogues_and_photographs(folder):
    catalog = folder / "catalog.csv"
    good = catalog.read_text()
    catalog.write_text(good.replace("diameter(mm)", "diameter"))
    assert "catalog.csv: 'diameter': unknown column; did you mean diameter(mm)?" in refused(folder)
    catalog.write_text(good.replace("6.5\n", "big\n"))
    assert "catalog.csv, line 4: diameter(mm) = 'big': expected a number" in refused(folder)
    catalog.write_text(good.replace("6.500mm/0", "../calib2/0"))
    assert "line 4: image = '../calib2/0/gelsight.png': not inside" in refused(folder)
    catalog.write_text(good + "4.000mm/0,4\n")
    assert "line 5: experiment_reldir = '4.000mm/0': named twice" in refused(folder)
    catalog.write_text(good + "4.000mm/7,4\n")
    assert "line 5: image = '4.000mm/7/gelsight.png': not in" in refused(folder)
    catalog.write_text(good)
    Image.new("RGB", (48, 64)).save(folder / "4.000mm/1/gelsight.png")
    assert "size = 48 x 64 px: expected the background's 64 x 48" in refused(folder)
    (folder / "background.png").unlink()
    assert "background.png: no such file" in refused(folder)
