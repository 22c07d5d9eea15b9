"""The page of two builds."""

import re

import pytest
from two_builds import FASTER, build

from fastac.report import comparison
from fastac.report.differences import Difference


def test_bars_have_one_logarithmic_scale():
    figures = [
        Difference("a", 1.0, 4.0),
        Difference("b", 1.0, 0.5),
        Difference("c", 0.0, 1.0),
        Difference("d", None, 1.0),
    ]
    more, less = comparison.bars(figures)
    assert (more.left_percent, more.width_percent) == (50, 50)
    assert (less.left_percent, less.width_percent) == (25, 25)
    assert (more.values, less.values) == ("1 → 4", "1 → 0.5")
    [small] = comparison.bars([Difference("a", 1.0, 1.1)])
    assert small.width_percent < 7


@pytest.fixture
def page(tmp_path):
    shown = comparison.read((build(tmp_path / "one"), build(tmp_path / "two", **FASTER)))
    comparison.write(shown, tmp_path / "page.html")
    return (tmp_path / "page.html").read_text()


def test_the_page_leads_with_the_figures_and_has_both_timelines(page):
    order = [
        "<h1>one and two</h1>",
        'class="headlines"',
        "two against one",
        "Where the cycles go",
        "The scenes",
    ]
    places = [page.index(text) for text in order]
    assert places == sorted(places)
    assert '<b>600 → 150</b><span class="good">-75.0%</span>' in page
    assert '<b>0.025 → 0.03</b><span class="bad">+20.0%</span>' in page
    assert page.count('<div class="timeline">') == 2
    assert "<td>poisson.solver</td><td>dst2d</td><td>tridiagonal</td>" in page


def test_the_page_opens_without_a_network(page):
    assert not re.search(r"https?://|src=\"(?!data:)|@import|url\(", page)


def test_a_sentence_says_that_frames_differ(tmp_path):
    other = build(tmp_path / "b", scene__protocol__seed=2)
    comparison.write(comparison.read((build(tmp_path / "a"), other)), tmp_path / "page.html")
    assert '<p class="bad">Errors are on different simulated frames' in (tmp_path / "page.html").read_text()
