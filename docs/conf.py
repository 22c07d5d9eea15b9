"""Settings of the documentation site: `make docs`."""

import importlib.metadata
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "FasTac"
author = "the FasTac authors"
copyright = "the FasTac authors; Apache-2.0"
release = importlib.metadata.version("fastac")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_click", "fastac_docs"]
myst_enable_extensions = ["attrs_block", "attrs_inline", "dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
exclude_patterns = ["_ext", "**/.ipynb_checkpoints"]
smartquotes = False  # they would make one dash of the two before an option
default_role = "literal"  # in docstrings and the commands' help code is in single backticks
suppress_warnings = ["config.cache"]  # furo sets a function, which no cache can hold

nitpicky = True
nitpick_ignore_regex = [
    (r"py:.*", r"(collections|click|contextlib|enum|h5py|np|numpy|pathlib|pydantic|torch|typing)\..*"),
]
nitpick_ignore = [  # of ours, what only the source explains
    ("py:class", "fastac.models.integer.bundle.Bundle"),
    ("py:class", "fastac.scenes.schema.Scene"),
    ("py:class", "fastac.driver.description.Description"),
]
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_class_signature = "mixed"
python_maximum_signature_line_length = 88
add_module_names = False

html_theme = "furo"
html_title = f"FasTac {release}"
html_static_path = ["_static"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#1a56c4", "color-brand-content": "#1a56c4"},
    "dark_css_variables": {"color-brand-primary": "#7aa7ff", "color-brand-content": "#7aa7ff"},
}

linkcheck_timeout = 20
linkcheck_retries = 2
