"""The commands' help as reStructuredText, where sphinx-click takes it as it is for terminals."""

import re

from docutils import nodes
from sphinx.transforms import SphinxTransform

from fastac_docs.docstrings import marked

EXAMPLE = re.compile(r"^\| Example: (.+)$")

CONSOLE = ("Example:", "", ".. code-block:: console", "")


def description(app, context, lines: list[str]) -> None:
    """Marks of plain text escaped, and an example as a block of code."""
    found = []
    for line in lines:
        example = EXAMPLE.match(line)
        found += [*CONSOLE, f"   {example[1]}", ""] if example else [marked(line)]
    lines[:] = found


def options(app, context, lines: list[str]) -> None:
    """Marks of plain text escaped in the options' texts, in which sphinx-click has set some of its own."""
    ours = (".. ", ":")
    lines[:] = [
        line if line.strip().startswith(ours) else re.sub(r"(?<!\*)\*(?!\*)", r"\\*", line) for line in lines
    ]


class FullNames(SphinxTransform):
    """Headings of commands with all their words: "fastac bench driver", not "driver"."""

    default_priority = 400

    def apply(self, **kwargs) -> None:
        for section in self.document.findall(nodes.section):
            name = " ".join(section.get("names", ()))
            if name.startswith("fastac ") and name.endswith(f" {section[0].astext()}"):
                section[0].replace_self(nodes.title(name, name))
