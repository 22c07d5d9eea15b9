"""The view in three dimensions: what the script is given, and that a browser draws it."""

import base64
import json
import re
import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

from fastac.report import surface
from fastac.report.render import render

CHROMIUM = shutil.which("chromium")
QUIET = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--disable-quic"),
)


@pytest.fixture
def found():
    rng = np.random.default_rng(1)
    return SimpleNamespace(
        depth_mm=rng.uniform(0, 2, (2, 16, 16)), displacement_mm=rng.uniform(0, 0.5, (2, 14, 14))
    )


def test_heights_and_colours_of_each_frame(tiny_scene, found):
    view = json.loads(json.dumps(surface.view(tiny_scene, [26, 33], found)))
    assert (view["size"], view["pitchMm"], len(view["shades"])) == (14, 0.25, 64)
    assert [frame["name"] for frame in view["frames"]] == ["frame 26", "frame 33"]
    for k, frame in enumerate(view["frames"]):
        for part, values in (("height", found.depth_mm[k][1:-1, 1:-1]), ("colour", found.displacement_mm[k])):
            words = np.frombuffer(base64.b64decode(frame[part]["words"]), "<u2").reshape(14, 14)
            low, high = frame[part]["lowMm"], frame[part]["highMm"]
            np.testing.assert_allclose(low + (high - low) * words / 65535, values, atol=2e-5)


@pytest.mark.parametrize(("depth_mm", "rise"), [(3.0, 1), (0.3, 3), (0.001, 10), (0.0, 1)])
def test_a_flat_skin_is_drawn_higher_than_true(tiny_scene, found, depth_mm, rise):
    found.depth_mm[:] = np.linspace(0, depth_mm, 16)[:, None]
    assert surface.view(tiny_scene, [1, 2], found)["rise"] == rise


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_draws_it(tiny_scene, found, tmp_path):
    view = surface.view(tiny_scene, [26, 33], found)
    page = tmp_path / "page.html"
    page.write_text(
        f"""<!doctype html><div id="surface"><canvas style="width: 400px; height: 300px"></canvas>
        <select><option>a<option>b</select><input type="range" min="1" max="10"><output></output>
        <div class="ends"><span></span><span></span></div>
        <script type="application/json">{json.dumps(view)}</script></div>
        <script>{render("report/surface.js.j2")}</script>"""
    )
    command = [CHROMIUM, *QUIET, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", page.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    assert 'data-drawn="169"' in shown
    assert re.search(r"<output>× \d+</output>", shown)
    assert f"<span>{view['frames'][0]['colour']['highMm']:.3f} mm</span>" in shown
