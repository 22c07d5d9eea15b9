"""README and docs name files, commands and make targets that exist, and every command is documented."""

import re
from pathlib import Path

import click
import pytest

from fastac.cli.main import main

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
NAMED_FILE = re.compile(
    r"(?<![\w./-])(?<!--held-out )(?<!--background )"
    r"((?:[\w.-]+/)+[a-z_0-9.-]+\.(?:py|toml|md|png|vlt|j2|json))(?![\w/])"
)
"""A path with a folder in it, but for names in a recording: of groups held out and of backgrounds."""


NAMED_IN_FILE = re.compile(r"`([\w/]+\.py)`:?\s+`(\w+)[.`(]")
"""A function, class or constant behind the file that has it."""


def commands(group: click.Group, path: tuple[str, ...] = ()) -> dict[str, click.Command]:
    """Every command by its words: `import ball-press`."""
    found, context = {}, click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        inside = isinstance(command, click.Group)
        found |= commands(command, (*path, name)) if inside else {" ".join((*path, name)): command}
    return found


def pages():
    return [pytest.param(page, id=page.name) for page in PAGES]


@pytest.mark.parametrize("page", pages())
def test_files_that_are_named_exist(page):
    made = ("build/", "verilog/")
    named = {path for path in NAMED_FILE.findall(page.read_text()) if not path.startswith(made)}
    folders = (ROOT, ROOT / "tests", page.parent)
    assert [path for path in sorted(named) if not any((folder / path).exists() for folder in folders)] == []


@pytest.mark.parametrize("page", pages())
def test_functions_that_are_named_are_in_their_files(page):
    absent = [
        f"{path}: {name}"
        for path, name in NAMED_IN_FILE.findall(page.read_text())
        if not re.search(rf"^\s*(def |class )?{name}\b", (ROOT / path).read_text(), re.MULTILINE)
    ]
    assert absent == []


@pytest.mark.parametrize("page", pages())
def test_commands_that_are_named_exist(page):
    known = {name.split()[0] for name in commands(main)} | {"COMMAND"}
    named = set(re.findall(r"(?:`|bin/|^    )fastac ([A-Za-z-]+)", page.read_text(), re.MULTILINE))
    assert named - known == set()


@pytest.mark.parametrize("page", pages())
def test_make_targets_that_are_named_exist(page):
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    assert set(re.findall(r"`make ([a-z-]+)", page.read_text())) - targets == set()


def test_every_command_is_documented():
    text = (ROOT / "docs" / "commands.md").read_text()
    assert [
        name for name in commands(main) if f"`fastac {name} " not in text and f"`fastac {name}`" not in text
    ] == []


def test_the_readme_is_one_page():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150
