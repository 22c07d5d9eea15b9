"""What our site needs beside Sphinx: pages made from the code, notebooks, formulas, links.

The modules that make pages give Markdown and import no Sphinx; `setup` is the extension.
"""

import shutil
from pathlib import Path

MOST_ARGUMENTS = 5


def setup(app) -> dict:
    """Called by Sphinx."""
    from docutils import nodes
    from sphinx.util.docutils import unregister_node

    from fastac_docs import commands, maths
    from fastac_docs.docstrings import to_rst
    from fastac_docs.links import Links
    from fastac_docs.notebooks import NotebookParser
    from fastac_docs.pages import expanded

    def read(app, docname, source):
        source[0] = expanded(source[0], Path(app.srcdir))

    def docstring(app, what, name, thing, options, lines):
        lines[:] = to_rst(lines)

    def signature(app, what, name, thing, options, arguments, returned):
        """Of a class with a field for everything that it may hold, none: its fields are explained below."""
        fields = getattr(thing, "__dataclass_fields__", ()) if what == "class" else ()
        return ("", "") if len(fields) > MOST_ARGUMENTS else None

    def fonts(app, error):
        if error is None and app.builder.format == "html":
            shutil.copy(maths.FONT, Path(app.outdir) / "_static" / maths.FONT.name)

    for node, visit in ((nodes.math, maths.visit_math), (nodes.math_block, maths.visit_math_block)):
        unregister_node(node)
        app.add_node(node, override=True, html=(visit, None))
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    app.add_transform(commands.FullNames)
    app.add_post_transform(Links)
    app.connect("source-read", read)
    app.connect("autodoc-process-docstring", docstring)
    app.connect("autodoc-process-signature", signature)
    app.connect("sphinx-click-process-description", commands.description)
    app.connect("sphinx-click-process-options", commands.options)
    app.connect("build-finished", fonts)
    app.add_css_file("site.css")
    return {"parallel_read_safe": True, "parallel_write_safe": True}
