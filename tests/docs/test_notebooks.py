"""Notebooks become Markdown: texts, code that is not executed, pictures; outputs are left out."""

import pytest

notebooks = pytest.importorskip("fastac_docs.notebooks")
nbformat = notebooks.nbformat
v4 = nbformat.v4


@pytest.fixture
def notebook() -> str:
    cells = [
        v4.new_markdown_cell("# Your gel\n\nText $x$."),
        v4.new_code_cell("1 / 0\n", outputs=[v4.new_output("stream", text="secret")]),
        v4.new_code_cell("'''\n```\n'''"),
        v4.new_code_cell(""),
        v4.new_markdown_cell("The end."),
    ]
    return nbformat.writes(v4.new_notebook(cells=cells))


def test_cells_in_order(notebook, tmp_path):
    text = notebooks.markdown(notebook, "gel", tmp_path)
    parts = ["# Your gel\n\nText $x$.", "`notebooks/gel.ipynb`", "```python\n1 / 0\n", "The end."]
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    assert "secret" not in text
    assert "````python\n'''\n```\n'''\n````" in text


def test_pictures_stand_where_their_names_say(notebook, tmp_path):
    for name in ("gel.png", "gel-02.png", "other.png"):
        (tmp_path / name).write_bytes(b"")
    text = notebooks.markdown(notebook, "gel", tmp_path)
    first, second = (text.index(f"(/images/notebooks/{name})") for name in ("gel.png", "gel-02.png"))
    assert text.index("# Your gel") < first < text.index("1 / 0") < second < text.index("The end.")
    assert "other.png" not in text
