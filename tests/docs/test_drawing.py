"""A diagram is SVG that Markdown takes as one block, with all blocks and words, in the page's colours."""

import re
from xml.etree import ElementTree

import pytest

from fastac_docs.datapaths import of_pipeline
from fastac_docs.drawing import svg

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def drawn(small_graph) -> str:
    return svg(small_graph, label="A & B")


def test_it_has_every_block_and_its_words(drawn, small_graph):
    root = ElementTree.fromstring(drawn)
    assert root.get("aria-label") == "A & B"
    texts = {element.text for element in root.iter(f"{SVG}text")}
    for block in small_graph.blocks:
        if block.kind in ("component", "port"):
            assert block.title in texts
    forks = {block.name for block in small_graph.blocks if block.kind == "fork"}
    assert {stream.words for stream in small_graph.streams if stream.source not in forks} <= texts
    assert f"{small_graph.block('mlp').latency} clocks, {small_graph.block('mlp').multipliers} DSP" in texts
    assert len(root.findall(f"{SVG}path")) == len(small_graph.streams)


def test_everything_is_inside_the_picture(drawn):
    root = ElementTree.fromstring(drawn)
    left, top, width, height = map(float, root.get("viewBox").split())
    for box in root.iter(f"{SVG}rect"):
        x, y, w, h = (float(box.get(key)) for key in ("x", "y", "width", "height"))
        assert left <= x
        assert x + w <= left + width
        assert top <= y
        assert y + h <= top + height


def test_no_colour_and_no_blank_line_of_its_own(drawn):
    assert not re.search(r"#[0-9a-fA-F]{3,6}\b|fill=|stroke=", drawn)
    assert "\n\n" not in drawn


def test_the_table_adds_up_to_the_latency(small_bundle):
    text = of_pipeline(small_bundle.pipeline)
    clocks = [int(n.replace(",", "")) for n in re.findall(r"^\| [a-z ]+ \| ([\d,]+) \|$", text, re.MULTILINE)]
    (total,) = re.findall(r"\*\*([\d,]+)\*\*", text)
    assert sum(clocks) == int(total.replace(",", ""))
    assert "16 × 16 pixels, 2 a clock" in text
