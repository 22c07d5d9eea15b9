"""The commands that import the layouts of other projects."""

from command_line import fail, succeed
from miniatures import fots_folder, gs_sdk_folder

SIZE = ("--height-px", 32, "--width-px", 32, "--no-progress")


def test_gs_sdk_writes_a_dataset(tmp_path):
    folder = gs_sdk_folder(tmp_path / "calib")
    command = ("import", "gs-sdk", folder, "--px-per-mm", 10, "-o", tmp_path / "out" / "d.h5", *SIZE)
    said = succeed(*command).stdout
    assert said == f"{tmp_path}/out/d.h5: 4 frames (4 train, 0 validation, 0 test), pitch 0.20000 mm\n"
    (folder / "6.500mm/0/label.npz").unlink()
    assert "label.npz: no such file" in fail(*command)
    said = succeed(*command, "--skip-unlabelled").stdout
    assert "3 frames (3 train, 0 validation, 0 test), 1 left out, pitch" in said


def test_fots_writes_a_dataset(tmp_path):
    folder = fots_folder(tmp_path / "mlp_calib")
    command = ("import", "fots", folder, "--ball-mm", 4, "--px-per-mm", 10, "-o", tmp_path / "d.h5", *SIZE)
    assert "6 frames (5 train, 0 validation, 1 test), pitch" in succeed(*command).stdout
    assert "ball_mm = -1: expected more than 0" in fail(*command, "--ball-mm", -1)
