"""The picture of a finished build: which panels a scene has, and what its heading says."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from fastac.models.emulator.pipeline import Emulator
from fastac.report import picture

REPORT = {
    "rtl_vs_integer": {"frame_indices": [26, 33], "values_compared": 123_456, "mismatches": 0},
    "latency_cycles": {"first_pixel_to_force": 3000, "last_pixel_to_force": 2700, "initiation_interval": 300},
    "latency_cycles_by_formula": {"stage": {"normals": 40, "depth": 2000}},
}


def test_pictures_are_red_green_blue():
    frame = np.zeros((1, 1, 4), np.uint8)
    frame[0, 0] = (1, 2, 3, 99)  # B, G, R, NIR
    np.testing.assert_array_equal(picture.rgb(frame)[0, 0], [3, 2, 1])
    np.testing.assert_array_equal(picture.rgb(frame[..., :3])[0, 0], [3, 2, 1])


def test_the_heading_has_what_was_counted():
    assert picture.heading(REPORT) == (
        "hardware against integers: 0 mismatches in 123,456 values; first pixel → force: 3,000 cycles;"
        " a new frame every: 300 cycles"
    )


def test_stages_follow_each_other_in_the_bar():
    _, axis = plt.subplots()
    picture.draw_cycles(axis, {"normals": 40, "depth": 2000})
    assert [(bar.get_x(), bar.get_width()) for bar in axis.patches] == [(0, 40), (40, 2000)]
    assert [container.get_label() for container in axis.containers] == ["normals: 40", "depth: 2,000"]
    plt.close()


@pytest.mark.parametrize(
    ("labels", "with_depth", "titles"),
    [
        ("geometry", True, ["input (RGB)", "NIR", "normals", "depth, mm", "displacement, mm"]),
        ("geometry", False, ["input (RGB)", "NIR", "normals"]),
        ("force", False, ["input (RGB)", "NIR"]),
    ],
)
def test_panels_of_a_frame(tiny_bundle, tiny_data, labels, with_depth, titles):
    found = Emulator(tiny_bundle.pipeline).run(tiny_data.frames[3:4])
    if not with_depth:
        found = replace(found, depth_mm=None, displacement_mm=None)
    panels = picture.images(tiny_data, 3, found, labels)
    assert [title for title, _, _ in panels] == titles
    np.testing.assert_array_equal(panels[0][1], tiny_data.frames[3][..., 2::-1])
    assert {image.shape[:2] for _, image, _ in panels} <= {(16, 16), (14, 14)}


@pytest.mark.parametrize("with_force", [True, False])
def test_it_is_drawn_whole(tiny_bundle, tiny_data, tmp_path, with_force):
    data = tiny_data if with_force else replace(tiny_data, force_n=None)
    picture.write(tmp_path / "p.png", tiny_bundle, data, REPORT)
    assert [path.name for path in tmp_path.iterdir()] == ["p.png"]
    with Image.open(tmp_path / "p.png") as image:
        width, height = image.size
        assert (width, height) == (230 * (6 if with_force else 5), 440)
        assert np.asarray(image.convert("L")).std() > 10
