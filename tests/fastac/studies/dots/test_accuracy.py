"""The study of dots prints the errors of both ways for each load and drag, and says what a dataset lacks."""

import dots
import numpy as np
import pytest
from command_line import fail, succeed

from fastac.sensor import dataset
from fastac.sensor.optics.marker_grid import marker_pixels

SIDE, PITCH = 48, 0.1


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "dotted.toml"
    path.write_text(f"""
outputs = ["force_xyz"]
[sensor]
geometry = "flat"
height_px = {SIDE}
width_px = {SIDE}
pitch_mm = {PITCH}
channels = "bgr+nir"
elastomer = {{ rim_mm = 0.6, mechanics = "fem", friction = 1.0 }}
markers = {{ spacing_mm = {dots.SPACING_PX * PITCH}, radius_mm = {dots.RADIUS_PX * PITCH} }}
[poisson]
solver = "adjoint"
[force]
clamp = false
""")
    return path


def write(path, scene_file, **arrays):
    from fastac.scenes.schema import load

    rest = marker_pixels(load(scene_file).sensor)
    shifts = np.array([(0.0, 0.0), (2.0, 0.0), (0.0, -3.0)])[:, None] * np.ones((len(rest), 1))
    given = {
        "frames": np.stack([dots.frame(SIDE, SIDE, rest + shift) for shift in shifts]),
        "background": dots.frame(SIDE, SIDE, rest),
        "markers_px": rest + shifts,
        "force_n": np.array([(0, 0, 0.5), (0.3, 0, 1.0), (0, -0.6, 1.0)]),
        "split": np.array(["train", "test", "test"]),
        "normals": np.broadcast_to([0.0, 0.0, 1.0], (3, SIDE, SIDE, 3)),
        "rest_depth_mm": np.zeros((SIDE, SIDE)),
    }
    kept = {key: value for key, value in (given | arrays).items() if value is not None}
    dataset.write(path, pitch_mm=PITCH, channels=("B", "G", "R", "NIR"), source="drawn", **kept)
    return path


def test_errors_of_both_ways(tmp_path, scene_file):
    data = write(tmp_path / "d.h5", scene_file)
    head, titles, *rows = succeed("study", "dots", scene_file, data, "--no-progress").output.splitlines()
    assert head.endswith("dots, shifts against their true places; drawn")
    assert titles.split()[:2] == ["split", "F_z,"]
    cells = [row.split() for row in rows]
    assert [row[:5] for row in cells] == [
        ["train", "0.5", "0", "1", "0.0"],
        ["train", "all", "all", "1", "0.0"],
        ["test", "1", "0.3", "1", "2.0"],
        ["test", "1", "0.6", "1", "3.0"],
        ["test", "all", "all", "2", "3.0"],
    ]
    for row in cells:
        assert float(row[5]) < 0.05
        assert float(row[9]) < 0.1
        assert row[8] == row[12] == "0"


def test_what_a_dataset_lacks(tmp_path, scene_file):
    data = write(tmp_path / "d.h5", scene_file, markers_px=None)
    failure = fail("study", "dots", scene_file, data)
    assert "d.h5: expected force_n of three axes, and markers_px of 9 dots" in failure
