"""Which part holds which scene at which camera rate."""

import pytest

from fastac.report import chips
from fastac.scenes.pace import Pace
from fastac.synth.fits import random_pipeline

PARTS = 4


@pytest.fixture(scope="module")
def pipeline(make_scene):
    return random_pipeline(make_scene())


def test_a_faster_camera_needs_more_hardware(pipeline):
    slow, fast = (chips.fit(pipeline, "xc7z020clg400-1", rate, 100) for rate in (240, 200_000))
    assert (slow.pace, fast.pace) == (Pace(1, 16), Pace(1, 1))
    assert slow.area.fits
    assert sum(slow.area.multipliers.values()) < sum(fast.area.multipliers.values())
    assert slow.text.startswith("1/16 px/clock: DSP48E1 ")


def test_a_camera_that_no_hardware_keeps_up_with(pipeline):
    found = chips.fit(pipeline, "xc7z020clg400-1", 1e7, 100)
    assert (found.pace, found.text) == (None, "no: too fast")


def test_table(make_scene):
    lines = chips.table([make_scene()], (60, 1e7), 100).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[: 2 + PARTS]]
    assert cells[0] == ["scene", "part, boards", "60 frames/s", "1e+07 frames/s"]
    assert [row[-1] for row in cells[2:]] == ["no: too fast"] * PARTS
    assert {row[0] for row in cells[2:]} == {"tiny"}
    assert "At 100 MHz, an assumption" in "\n".join(lines)
