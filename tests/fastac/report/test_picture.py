"""The picture of a finished build: which panels a scene has, and what its heading says."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fastac.report import picture

REPORT = {
    "rtl_vs_integer": {"frame_indices": [26, 33], "values_compared": 123_456, "mismatches": 0},
    "latency_cycles": {"first_pixel_to_force": 3000, "last_pixel_to_force": 2700, "initiation_interval": 300},
    "latency_cycles_by_formula": {"stage": {"normals": 40, "source": 2000}},
}


def test_the_heading_has_what_was_counted():
    assert picture.heading(REPORT) == (
        "hardware against integers: 0 mismatches in 123,456 values; first pixel → force: 3,000 cycles;"
        " a new frame every: 300 cycles"
    )


@pytest.mark.parametrize("with_force", [True, False])
def test_it_is_drawn_whole(tiny_bundle, tiny_data, tmp_path, with_force):
    data = tiny_data if with_force else replace(tiny_data, force_n=None)
    picture.write(tmp_path / "p.png", tiny_bundle, data, REPORT)
    assert [path.name for path in tmp_path.iterdir()] == ["p.png"]
    with Image.open(tmp_path / "p.png") as image:
        width, height = image.size
        assert width == 230 * (6 if with_force else 5)
        assert height == pytest.approx(100 * (picture.UPPER_IN + 0.9 + 0.17 * 3), abs=1)
        assert np.asarray(image.convert("L")).std() > 10
