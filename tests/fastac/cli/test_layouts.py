"""The commands that import the layouts of other projects."""

import pickle

import pytest
from command_line import fail, succeed
from miniatures import (
    estimate_modulus_folder,
    feats_folder,
    fots_folder,
    gs_sdk_folder,
    tacbench_folder,
    taxim_pack,
)

from fastac.cli.import_options import say_forces
from fastac.sensor.importers.delays import Delay
from fastac.sensor.importers.force_frames import Written

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


def test_taxim_writes_a_dataset(tmp_path):
    pack = taxim_pack(tmp_path / "calibs") / "dataPack.npz"
    command = ("import", "taxim", pack, "--ball-mm", 4, "--px-per-mm", 5, "-o", tmp_path / "d.h5", *SIZE)
    assert fail(*command).endswith(
        "frame_1.jpg: radius_px = 12: 2.400 mm at 5 px/mm, expected less than the ball's radius of 2 mm;"
        " --radius-reduction-px makes circles smaller, --skip-bad-circles leaves such presses out"
    )
    said = succeed(*command, "--radius-reduction-px", 4).stdout
    assert "6 frames (5 train, 0 validation, 1 test), pitch" in said


def test_feats_writes_a_dataset(tmp_path):
    folder = feats_folder(tmp_path / "labels")
    command = ("import", "feats", folder, "--background", folder / "rest.npy", "--pitch-mm", 0.2)
    command = (*command, "-o", tmp_path / "d.h5", *SIZE)
    assert succeed(*command).stdout.splitlines() == [
        f"{tmp_path}/d.h5: 6 frames (3 train, 1 validation, 2 test), force x, y, z",
        "test: ring",
    ]
    assert succeed(*command, "--held-out", "cuboid_10").stdout.endswith("test: cuboid_10\n")
    assert "group 'nut': expected one of" in fail(*command, "--held-out", "nut")


def test_estimate_modulus_writes_a_dataset(tmp_path):
    folder = estimate_modulus_folder(tmp_path / "grasps")
    command = ("import", "estimate-modulus", folder, "--background-frames", 2, "--pitch-mm", 0.2)
    command = (*command, "-o", tmp_path / "d.h5", *SIZE)
    assert succeed(*command, "--crop-px", 16, 12, 16, 12).stdout.splitlines() == [
        f"{tmp_path}/d.h5: 18 frames (4 train, 2 validation, 12 test), force z",
        "test: golf_ball",
    ]
    assert "crop_px = 60, 12, 16, 12: not inside" in fail(*command, "--crop-px", 60, 12, 16, 12)
    (folder / "golf_ball__t=1_forces.pkl").write_bytes(pickle.dumps([0.0, 0.0, 1.0, 4.0, -3.0, -0.1]))
    assert succeed(*command).stdout.splitlines() == [
        f"{tmp_path}/d.h5: 17 frames (4 train, 2 validation, 11 test), 1 left out, force z",
        "test: golf_ball",
        "1 frames with F_z below -0.2 N are left out, for nothing pulls a skin; --keep-pulls keeps them",
    ]
    assert "18 frames" in succeed(*command, "--keep-pulls").stdout


def test_frames_and_forces_that_are_apart_are_told(tmp_path, capsys):
    folder, output = estimate_modulus_folder(tmp_path / "grasps"), tmp_path / "d.h5"
    command = ("import", "estimate-modulus", folder, "--background-frames", 2, "--pitch-mm", 0.2)
    command = (*command, *SIZE, "-o", output)
    assert "warning" not in succeed(*command).stderr
    found = (Delay("pear_1", 14, 0.812, -0.503), Delay("pear_2", -3, 0.9, 0.6))
    say_forces(output, Written(0, 1.0, found[:1]))
    assert capsys.readouterr().err == (
        f"warning: {output}: frames and forces of a recording are apart in time: those of pear_1 agree best"
        " where frames are 14 frames later (correlation 0.81 instead of -0.50); median +14 frames\n"
    )
    say_forces(output, Written(0, 1.0, found[1:] * 2))
    assert "of 2 recordings are apart" in (printed := capsys.readouterr().err)
    assert "those of pear_2 agree best where frames are 3 frames earlier" in printed
    assert printed.endswith("median -3 frames\n")
    assert "delay_frames = 9: expected less than" in fail(*command, "--delay-frames", 9)


def test_tacbench_writes_a_dataset(tmp_path):
    folder = tacbench_folder(tmp_path / "digit")
    command = ("import", "tacbench", folder, "--pitch-mm", 0.2, "-o", tmp_path / "d.h5", *SIZE)
    assert succeed(*command, "--held-out", "flat/batch_2").stdout.endswith("test: flat/batch_2\n")
    assert succeed(*command, "--group-by", "probe", "--every", 2).stdout.endswith("test: sphere\n")
    assert "force_z_n = -4 to -1, mostly negative" in fail(*command, "--negate")


def test_rosbag2_writes_a_dataset(tmp_path):
    pytest.importorskip("mcap", reason="the extra `ros` is not installed: pip install -e '.[ros]'")
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed: pip install -e '.[ros]'")
    from miniature_bags import messages, write_bag, write_mcap

    bags = write_bag(tmp_path / "pear", messages(lost=(4,))), write_mcap(tmp_path / "plum.mcap", messages())
    command = ("import", "rosbag2", *bags, "--background-frames", 2, "--pitch-mm", 0.2, *SIZE)
    command = (*command, "-o", tmp_path / "d.h5")
    assert succeed(*command, "--held-out", "pear").stdout.splitlines() == [
        f"{tmp_path}/d.h5: 17 frames (7 train, 2 validation, 8 test), 1 left out, force x, y, z",
        "test: pear",
    ]
    assert succeed(*command, "--group-by", "press").stdout.endswith("test: plum/2\n")
    assert "topic '/x' of" in fail(*command, "--wrench-topic", "/x")
