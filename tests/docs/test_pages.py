"""Comments in pages become what they name, and every page is in a table of contents."""

import pytest

from fastac_docs.pages import expanded, notebooks, other_pages


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "index.md").write_text("```{toctree}\n:hidden:\n\nhowto\n```\n")
    (tmp_path / "howto.md").write_text(
        "```{toctree}\none\nThe second <two>\n```\n\n<!-- made by: other_pages -->\n"
    )
    for name in ("one", "two", "ros", "live"):
        (tmp_path / f"{name}.md").write_text("# Page\n")
    return tmp_path


def test_pages_that_nobody_lists_are_added(folder):
    text = expanded((folder / "howto.md").read_text(), folder)
    assert text.endswith("```{toctree}\n:maxdepth: 1\n\nlive\nros\n```\n")


def test_nothing_is_left_over(folder):
    for name in ("ros", "live"):
        (folder / f"{name}.md").unlink()
    assert other_pages(folder) == ""


def test_notebooks_that_there_are(folder):
    assert notebooks(folder) == "This copy of the project has no notebooks."
    (folder / "notebooks").mkdir()
    for name in ("b", "a"):
        (folder / "notebooks" / f"{name}.ipynb").write_text("{}")
    assert "\nnotebooks/a\nnotebooks/b\n" in notebooks(folder)


def test_what_a_command_needs_is_shown(folder):
    text = expanded("<!-- needs: a board -->\n\n    fastac run x\n", folder)
    assert text == "{.needs}\nNot run by our tests: it needs a board.\n\n    fastac run x\n"


def test_an_unknown_maker_is_an_error(folder):
    with pytest.raises(KeyError, match="nobody"):
        expanded("<!-- made by: nobody -->", folder)
