import math

import pytest

from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.poses import COLUMNS, Pose, read, write

TOLD = Pose("train", 0, -4.5, 1 / 3, 4.25, 0.5, 0.15, -0.0)
DONE = Pose("test", 7, 1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.01, -0.02, 0.99)


def test_poses_survive_the_file(tmp_path):
    write(tmp_path / "poses.csv", [DONE])
    ((found, where),) = read(tmp_path / "poses.csv", measured=True)
    assert found == DONE
    assert where.endswith("poses.csv, line 2")
    assert found.is_vertical


def test_a_machine_is_told_no_forces_that_nobody_measured(tmp_path):
    write(tmp_path / "poses.csv", [TOLD])
    text = (tmp_path / "poses.csv").read_text()
    assert text.splitlines() == [
        "split,index,x_mm,y_mm,z_mm,load_n,tangential_x_n,tangential_y_n",
        "train,0,-4.5,0.333333333,4.25,0.5,0.15,0",
    ]
    ((found, _),) = read(tmp_path / "poses.csv", measured=False)
    assert not found.is_vertical
    assert math.isnan(found.force_z_n)
    with pytest.raises(ImportFailure, match="force_x_n: missing column"):
        read(tmp_path / "poses.csv", measured=True)


HEAD = ",".join(COLUMNS)
ROW = "train,0,1,2,3,1,0,0,0.1,0.1,1"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such file"),
        ("", "split: missing column"),
        (HEAD, "expected at least one row"),
        (HEAD.replace("z_mm,", "") + "\n" + ROW, "z_mm: missing column"),
        (HEAD + ",colour\n" + ROW + ",red", "'colour': unknown column; expected split, index"),
        (HEAD + "\n" + ROW.replace("train", "trian"), "line 2: split = 'trian': expected one of train"),
        (HEAD + "\n" + ROW.replace("3", "high"), "line 2: z_mm = 'high': expected a number"),
        (HEAD + "\n" + ROW.replace("3", "nan"), "line 2: z_mm = 'nan': expected a number"),
        (HEAD + "\n" + ROW.replace(",0,", ",0.5,", 1), r"line 2: index = '0\.5': expected a whole number"),
        (HEAD + "\n" + ROW + "\n" + ROW, "line 3: index = 0: named twice"),
        (HEAD + "\n" + ROW + ",5", "line 2: 12 values: expected 11, one for each column"),
        (HEAD + "\n" + ROW[:-2], "line 2: force_z_n: missing value"),
        (
            HEAD.replace("z_mm", "z_nm") + "\n" + ROW,
            r"poses\.csv: 'z_nm': unknown column; did you mean z_mm\?",
        ),
        (HEAD + "\n" + ROW.replace(",0,", ",-1,", 1), r"line 2: index = '-1': expected at least 0"),
        (b"\xff\xfe\x00", "not a readable CSV file"),
    ],
)
def test_refuses_a_bad_file_in_one_line(tmp_path, text, message):
    path = tmp_path / "poses.csv"
    if isinstance(text, bytes):
        path.write_bytes(text)
    elif text is not None:
        path.write_text(text)
    with pytest.raises(ImportFailure, match=message) as error:
        read(path, measured=True)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
