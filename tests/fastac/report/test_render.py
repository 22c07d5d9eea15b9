import base64
import subprocess
import sys

import jinja2
import matplotlib.pyplot as plt
import pytest

from fastac.report import figures
from fastac.report.headline import Headline
from fastac.report.render import render
from fastac.report.tables import Table

VALUES = {
    "content": {"scene": {"name": "a<b"}, "bundle_sha256": "ab" * 32, "frames_are": "simulated"},
    "whose": "Ours and the paper's.",
    "headlines": [Headline("depth", "<1 mm", "goal ≤ 2: reached")],
    "goals": Table("Goals", ["figure", "ours"], [["depth", "<1"]], "A note."),
    "sections": [("Geometry", None, [], [("depth", "iVBO")]), ("Force", "no force", [], [])],
}
PAGE = "studies/reproduce/reproduction.html.j2"


def test_a_page_has_the_look_of_the_base_and_its_own_content():
    page = render(PAGE, **VALUES)
    assert page.startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert page.count("<style>") == page.count("<title>") == 1
    assert "<title>FasTac: the paper's tables, a&lt;b</title>" in page
    assert "<td>&lt;1</td>" in page
    assert '<p class="note">A note.</p>' in page
    assert '<p class="note">Absent: no force.</p>' in page
    assert '<img class="chart" alt="depth" src="data:image/png;base64,iVBO">' in page
    assert "<b>&lt;1 mm</b><span>goal ≤ 2: reached</span>" in page
    assert page.index("headlines") < page.index("<h3>Goals</h3>")


def test_every_page_suits_narrow_screens_and_dark_colours():
    page = render(PAGE, **VALUES)
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    assert "color-scheme: light dark" in page
    assert "@media (prefers-color-scheme: dark)" in page
    assert "@media (max-width: 640px)" in page


def test_a_value_that_is_missing_is_an_error():
    with pytest.raises(jinja2.UndefinedError, match="whose"):
        render(PAGE, **{key: value for key, value in VALUES.items() if key != "whose"})


def test_figures_are_png_in_files_and_in_pages(tmp_path):
    path = tmp_path / "new" / "figure.png"
    figures.save_png(plt.figure(figsize=(1, 1)), path)
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert list(path.parent.iterdir()) == [path]
    assert base64.b64decode(figures.base64_png(path)) == path.read_bytes()
    assert base64.b64decode(figures.base64_png(plt.figure(figsize=(1, 1))))[:4] == b"\x89PNG"
    assert not plt.get_fignums()


@pytest.mark.full
def test_a_program_keeps_its_own_backend():
    """A notebook shows its figures in place, whatever it imports from builds and sweeps."""
    program = (
        "import matplotlib; matplotlib.use('svg');"
        "import fastac.flow.build, fastac.report.picture, fastac.sweep.page; print(matplotlib.get_backend())"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "svg"
