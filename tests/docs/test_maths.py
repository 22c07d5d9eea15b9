"""Formulas are MathML, and what is none stops the build with one line."""

import re
from xml.etree import ElementTree

import pytest
from documented_commands import PAGES

maths = pytest.importorskip("fastac_docs.maths")
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\w$`])\$([^\s$`][^$`]*)\$(?!\w)", re.DOTALL)


def formulas() -> list[str]:
    found = [match[1] or match[2] for page in PAGES for match in FORMULA.finditer(page.read_text())]
    return [formula for formula in found if "\n\n" not in formula]


def test_every_formula_of_the_pages_is_converted_whole():
    assert len(formulas()) > 50
    for formula in formulas():
        root = ElementTree.fromstring(maths.mathml(formula))
        text = "".join(root.itertext())
        assert "\\" not in text.replace("\\|", ""), formula
        assert root.tag.endswith("math")


def test_display_and_bars():
    assert 'display="block"' in maths.mathml("x", display=True)
    assert maths.mathml("|x|").count('lspace="0" rspace="0"') == 2


def test_what_is_no_formula():
    with pytest.raises(Exception, match=r"formula '.+frac': "):
        maths.mathml("\\frac")


def test_the_font_is_there():
    assert maths.FONT.is_file()
