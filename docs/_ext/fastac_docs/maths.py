"""Formulas as MathML, made when the site is built: browsers show it without network or scripts."""

import re
from pathlib import Path

import latex2mathml.exceptions
import ziamath
from docutils import nodes
from latex2mathml.converter import convert
from sphinx.errors import ExtensionError

FONT = Path(ziamath.__file__).parent / "fonts" / "STIXTwoMath-Regular.ttf"
"""A font with the tables that MathML needs; few systems have one. SIL Open Font License."""
REFUSALS = tuple(
    kind
    for kind in vars(latex2mathml.exceptions).values()
    if isinstance(kind, type) and issubclass(kind, Exception)
)
BARS = re.compile(r"<mo>(&#x0007C;|\|)</mo>|<mo stretchy=\"false\">(&#x0007C;|\|)</mo>")

FUNCTIONS = re.compile(r"<mi>(cos|sin)</mi>")
"""Bars and functions between whose signs the converter leaves other gaps than LaTeX does."""


def mathml(latex: str, *, display: bool = False) -> str:
    """The formula as a <math> element. Raises ExtensionError, in one line, for what is no formula."""
    try:
        found = convert(latex, display="block" if display else "inline")
    except (*REFUSALS, ValueError, IndexError, KeyError) as error:
        raise ExtensionError(f"formula {latex!r}: {type(error).__name__} {error}") from None
    found = FUNCTIONS.sub(r'<mspace width="0.17em"/>\g<0><mspace width="0.17em"/>', found)
    return BARS.sub('<mo stretchy="false" lspace="0" rspace="0">|</mo>', found)


def visit_math(translator, node: nodes.math) -> None:
    translator.body.append(f"{mathml(node.astext())}&#8288;")  # no line ends before a comma behind it
    raise nodes.SkipNode


def visit_math_block(translator, node: nodes.math_block) -> None:
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    translator.body.append(mathml(node.astext(), display=True))
    translator.body.append("</div>")
    raise nodes.SkipNode
