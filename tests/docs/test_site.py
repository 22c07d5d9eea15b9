"""The whole site, as `make docs` builds it: no warnings, what the code says, links that lead somewhere."""

import html
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from documented_commands import ROOT

from fastac.gateware.bus.register_map import REGISTERS
from fastac.scenes.schema import Scene, load
from fastac_docs.datapaths import pipeline_of

pytest.importorskip("sphinx")
pytestmark = [pytest.mark.full, pytest.mark.long]
PAGE = "build/docs/html"


@pytest.fixture(scope="session")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site") / "html"
    (recipe,) = re.findall(rf"^\t\S+/python (-m sphinx .* {PAGE})$", (ROOT / "Makefile").read_text(), re.M)
    words = [str(folder) if word == PAGE else word for word in shlex.split(recipe)]
    words += ["--doctree-dir", str(folder.with_name("doctrees"))]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="session")
def pages(site) -> dict[str, str]:
    """{path: HTML} of all pages."""
    return {str(path.relative_to(site)): path.read_text(encoding="utf-8") for path in site.rglob("*.html")}


def text_of(page: str) -> str:
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", page)))


def test_every_page_and_notebook_is_there(pages):
    sources = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("notebooks/*.ipynb")]
    assert {f"{path.relative_to(ROOT / 'docs').with_suffix('')}.html" for path in sources} <= pages.keys()


def test_links_inside_the_site_lead_somewhere(pages, site):
    ids = {name: set(re.findall(r'\bid="([^"]+)"', page)) for name, page in pages.items()}
    for name, page in pages.items():
        for link in re.findall(r'<a [^>]*href="([^"]+)"', page):
            parts = urlsplit(html.unescape(link))
            if parts.scheme:
                continue
            target = (site / name).parent / unquote(parts.path) if parts.path else site / name
            assert target.is_file(), f"{name}: {link}"
            if parts.fragment and target.suffix == ".html":
                found = str(target.resolve().relative_to(site.resolve()))
                assert parts.fragment in ids[found], f"{name}: {link}"


def test_nothing_comes_from_other_servers(pages, site):
    for name, page in pages.items():
        assert re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(?:https?:)?//[^"]+"', page) == [], name
    for style in site.glob("_static/**/*.css"):
        assert not re.search(r"(?:url\(|@import )[\"']?https?:", style.read_text(encoding="utf-8")), style


def test_formulas_are_in_the_page(pages, site):
    assert pages["mathematics.html"].count("<math ") > 40
    assert (site / "_static" / "STIXTwoMath-Regular.ttf").is_file()


def test_diagrams_have_the_widths_of_the_code(pages):
    page = pages["datapaths.html"]
    assert page.count('<svg class="block-diagram"') == 5
    slope = load(ROOT / "scenes" / "paper.toml").numbers.slope_bits
    assert f"1 × 2 × signed {slope}" in page
    assert f"1 × signed {pipeline_of('paper').depth.width}" in page
    assert "48,918" in page


def test_commands_have_their_options(pages):
    text = text_of(pages["options.html"])
    assert "fastac study force-ablation" in text
    assert "--capture-background" in text
    assert "fastac run build/paper --via sim --frames 3 --csv forces.csv" in text


def test_registers_and_keys(pages):
    for register in REGISTERS:
        assert f'id="register-{register.name.lower().replace("_", "-")}"' in pages["registers.html"]
    for table in Scene.model_fields:
        assert f'id="key-{table}"' in pages["scene_keys.html"]


def test_python(pages):
    text = text_of(pages["python_reference.html"])
    for name in (
        "load(",
        "TactileSensor",
        "Measurement",
        "Driver",
        "with_background(",
        "capture_background(",
    ):
        assert name in text
    assert "Raises BundleError, one line that names the file at fault" in text


def test_names_in_texts_are_links(pages):
    page = pages["scenes.html"]
    assert 'href="scene_keys.html#key-hardware-part"' in page
    assert 'href="options.html#fastac-scope"' in page
    assert 'href="simulation.html"' in page
