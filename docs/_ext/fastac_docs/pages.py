"""What pages get before they are parsed, where a comment in them says so.

`<!-- made by: scene_keys -->` becomes the text that `scene_keys` makes, and `<!-- needs: a board -->` a line
above the commands that no test runs.
"""

import re
from pathlib import Path

from fastac_docs import datapaths, registers, scene_keys

MADE = re.compile(r"^<!-- made by: (\w+) ?([\w/-]*) -->$", re.MULTILINE)
NEEDS = re.compile(r"^<!-- needs: (.+?) -->$", re.MULTILINE)
LISTED = re.compile(r"^(?:[\w/-]+|.*<([\w/-]+)>)$", re.MULTILINE)
TOCTREE = re.compile(r"```\{toctree\}\n(.*?)```", re.DOTALL)


def expanded(text: str, folder: Path) -> str:
    """A page's text with what its comments name; `folder` has the other pages.

    Raises KeyError for a name that there is not.
    """
    makers = {
        "scene_keys": lambda argument: scene_keys.scene_keys(),
        "registers": lambda argument: registers.registers(),
        "datapath": datapaths.datapath,
        "notebooks": lambda argument: notebooks(folder),
        "other_pages": lambda argument: other_pages(folder),
    }
    text = MADE.sub(lambda match: makers[match[1]](match[2]), text)
    return NEEDS.sub(lambda match: f"{{.needs}}\nNot run by our tests: it needs {match[1]}.", text)


def notebooks(folder: Path) -> str:
    """A toctree of the notebooks beside the folder; a sentence if there are none."""
    found = sorted(f"notebooks/{path.stem}" for path in folder.glob("notebooks/*.ipynb"))
    return _toctree(found) or "This copy of the project has no notebooks."


def other_pages(folder: Path) -> str:
    """A toctree of the pages that no page of the folder lists; "" if there are none."""
    listed = {"index"}
    for page in folder.glob("*.md"):
        for tree in TOCTREE.findall(page.read_text(encoding="utf-8")):
            listed |= {match[1] or match[0] for match in LISTED.finditer(tree)}
    found = sorted(page.stem for page in folder.glob("*.md") if page.stem not in listed)
    return _toctree(found)


def _toctree(names: list[str]) -> str:
    return "\n".join(["```{toctree}", ":maxdepth: 1", "", *names, "```"]) if names else ""
