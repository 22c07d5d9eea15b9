"""The benchmark of the live view, in a real browser."""

import re

import pytest
from headless_browser import chromium
from PIL import Image

from fastac.streaming.views import rerun_view
from fastac.studies.benchmarks import live


@pytest.mark.full
def test_rates_first_picture_and_screenshot(tiny_folder, tiny_file, tmp_path):
    with chromium():  # skips where there is none
        pass
    lines = live.measure(tiny_folder, 40, str(tiny_file))
    assert "16 × 16 px, emulator, 40 frames" in lines[0]
    rows = lines[1].splitlines()
    assert len(rows) == (4 if rerun_view.installed() else 3)
    if rerun_view.installed():
        assert re.search(r"kB a frame +\d+ +[\d.]+ +40 +0$", rows[-1])  # every frame is kept
    assert re.fullmatch(r"first picture in the browser [\d.]+ s after fastac live began", lines[2])
    live.screenshot(tiny_folder, tmp_path / "live.png", 3, str(tiny_file))
    with Image.open(tmp_path / "live.png") as picture:
        assert picture.size == live.SIZE_PX
        assert len(picture.convert("RGB").getcolors(2**24)) > 50
