"""Our docstrings become reStructuredText with the same words."""

import pytest

from fastac_docs.docstrings import marked, to_rst

TEXT = """\
Find the force, in `axes`.

frames, more : (H, W, C) uint8; where RAW10,
    also uint16
progress : whether to show *bars*

Raises ValueError for `frame`s of another shape_.

    sensor = fastac.load("build")

    found = sensor.run(frame)

>>> sensor.run(frames).force_n.shape
(200, 1)

Members
-------
o : a stream"""


def test_lists_code_and_headings():
    nodes = pytest.importorskip("docutils.nodes")
    publish_doctree = pytest.importorskip("docutils.core").publish_doctree
    tree = publish_doctree(
        "\n".join(to_rst(TEXT.splitlines())), settings_overrides={"report_level": 1, "halt_level": 1}
    )
    items = [item.astext().split("\n\n") for item in tree.findall(nodes.definition_list_item)]
    assert items == [
        ["frames, more", "(H, W, C) uint8; where RAW10,\nalso uint16"],
        ["progress", "whether to show *bars*"],
        ["o", "a stream"],
    ]
    blocks = [block.astext() for block in tree.findall(nodes.literal_block)]
    assert blocks == ['sensor = fastac.load("build")\n\nfound = sensor.run(frame)']
    assert "axes" in [code.astext() for code in tree.findall(nodes.literal)]
    assert "Raises ValueError for frames of another shape_." in tree.astext()
    assert "Members" in tree.astext()


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("`a` and `b`s", "``a`` and ``b``\\ s"),
        ("2 * 3 | 4", "2 \\* 3 \\| 4"),
        ("name_ and a_b", "name\\_ and a_b"),
        ("``kept``", "``kept``"),
    ],
)
def test_marks(line, found):
    assert marked(line) == found
