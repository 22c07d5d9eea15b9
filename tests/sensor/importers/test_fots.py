import numpy as np
import pytest
from miniatures import fots_folder

from fastac.sensor.dataset import read
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.fots import import_folder

HEADER = "img_names,center_x,center_y,radius\n"


@pytest.fixture
def folder(tmp_path):
    return fots_folder(tmp_path / "mlp_calib")


def imported(folder, **changed):
    given = {"ball_mm": 4.0, "px_per_mm": 10.0, "height_px": 32, "width_px": 32, "progress": False}
    import_folder(folder, output=folder.parent / "out.h5", **given | changed)
    return read(folder.parent / "out.h5")


def test_presses_are_in_the_order_of_their_names(folder):
    data = imported(folder)
    names = [f"gelsight/{k + 1:04d}.png" for k in range(5)]
    np.testing.assert_array_equal(data.group, [*names, "background"])
    np.testing.assert_array_equal(data.split, ["train"] * 4 + ["test", "train"])
    np.testing.assert_array_equal(data.frames[:5, 16, 16, 0], 50 + np.arange(5))
    np.testing.assert_allclose(np.diff(data.indenter["center_px"][:5, 0]), 0.5)


def test_presses_may_be_named_that_are_held_out(folder):
    held_out = ("gelsight/0001.png", "gelsight/0003.png")
    split = imported(folder, held_out=held_out).split
    np.testing.assert_array_equal(split, ["test", "train", "test", "train", "train", "train"])
    everything = tuple(f"gelsight/{k + 1:04d}.png" for k in range(5))
    for names, message in (
        (("0001.png",), r"annotate\.csv: group '0001\.png': expected one of gelsight/0001\.png, "),
        (everything, "group: all 5 are held out, none is left to train on"),
    ):
        with pytest.raises(ImportFailure, match=message):
            imported(folder, held_out=names)


def test_the_later_circle_counts(folder):
    table = folder / "csv" / "annotate.csv"
    table.write_text(table.read_text() + "C:\\x\\gelsight\\0001.png,20,30,8\n")
    assert imported(folder).indenter["radius_px"][0] == 4


def test_the_column_of_digit_depth(folder):
    table = folder / "csv" / "annotate.csv"
    expected = imported(folder).indenter["center_px"]
    table.write_text(table.read_text().replace("img_names", "img_name"))
    (folder / "0000.png").rename(folder / "gelsight" / "rest.png")
    data = imported(folder, background="gelsight/rest.png")
    np.testing.assert_array_equal(data.indenter["center_px"], expected)


def test_errors(folder):
    table = folder / "csv" / "annotate.csv"
    for rows, message in (
        ("gelsight/0009.png,20,30,12\n", r"line 2: image = 'gelsight/0009\.png': not in"),
        ("gelsight/0001.png,20,x,12\n", "line 2: center_y = 'x': expected a number"),
        ("gelsight/0001.png,20,30,25\n", "line 2: radius_px = 25: 2.500 mm"),
    ):
        table.write_text(HEADER + rows)
        with pytest.raises(ImportFailure, match=message):
            imported(folder)
    table.write_text("img_names,center_x,center_y\n")
    with pytest.raises(ImportFailure, match=r"annotate\.csv: radius: missing column"):
        imported(folder)
    table.write_text(HEADER + "gelsight/0001.png,20,30,12\n")
    with pytest.raises(ImportFailure, match=r"rest\.png: no such file"):
        imported(folder, background="rest.png")
    with pytest.raises(ImportFailure, match="ball_mm = 0: expected more than 0"):
        imported(folder, ball_mm=0.0)
