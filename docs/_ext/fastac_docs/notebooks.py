"""Notebooks as pages: their cells in Markdown, not executed, with the pictures that belong to them."""

from pathlib import Path

import nbformat
from myst_parser.parsers.sphinx_ import MystParser

PICTURES = Path(__file__).resolve().parents[2] / "images" / "notebooks"


class NotebookParser(MystParser):
    """Parser of .ipynb files, for Sphinx."""

    supported = ("notebook",)

    def parse(self, inputstring, document):
        source = document.settings.env.doc2path(document.settings.env.docname)
        super().parse(markdown(inputstring, Path(source).stem), document)


def markdown(text: str, name: str, pictures: Path = PICTURES) -> str:
    """The cells of a notebook: texts as they are, code in fences, and all NAME*.png of the folder `pictures`.

    A picture stands behind the cell that its name's end tells, as in NAME-03.png, counted from 1; any other
    one behind the first text. Outputs are left out. Raises nbformat's errors where the text is no notebook.
    """
    notebook = nbformat.reads(text, as_version=4)
    language = notebook.metadata.get("kernelspec", {}).get("language", "python")
    parts = [_cell(cell, language) for cell in notebook.cells]
    note = (
        f"```{{note}}\nThis page is the notebook `notebooks/{name}.ipynb`. Open it in Jupyter to run it.\n```"
    )
    placed: dict[int, list[str]] = {0: [note]}
    for picture in sorted(pictures.glob(f"{name}*.png")):
        end = picture.stem.removeprefix(name).strip("-_")
        cell = int(end) - 1 if end.isdecimal() and 0 < int(end) <= len(parts) else 0
        placed.setdefault(cell, []).append(f"![A picture of this notebook](/images/notebooks/{picture.name})")
    found = []
    for k, part in enumerate(parts):
        found += [part, *placed.get(k, ())]
    return "\n\n".join(part for part in found if part)


def _cell(cell, language: str) -> str:
    if cell.cell_type == "markdown":
        return cell.source
    if cell.cell_type == "raw":
        return ""
    fence = "`" * max(3, cell.source.count("`") + 1)
    return f"{fence}{language}\n{cell.source}\n{fence}" if cell.source.strip() else ""
