"""Every command in the README and in docs/ exists, has the options that it is given there, and is run.

It is run here as it is written, on a sensor of 16×16 pixels, or run_by.toml names a test of it, or a comment
above it says what it needs that tests do not have: `<!-- needs: a board -->`.
"""

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import click
import pytest
from command_line import succeed
from documented_commands import PAGES, ROOT, Documented, in_sentences, shell_lines

from fastac.cli.main import main

RUN_BY = tomllib.loads(Path(__file__).with_name("run_by.toml").read_text())
"""{command: a test of it, or what else runs it}, of those that are not run below."""
WRITTEN = {
    "fastac calibration build/new --for build/paper -o new.bin": {},
    "fastac predict BUNDLE DATA -o FILE": {"BUNDLE": "build/paper", "DATA": "build/paper/data.h5"},
    "fastac protocol SCENE -o poses.csv --origin-mm X Y Z": {
        "SCENE": "scenes/paper.toml",
        "X": "10",
        "Y": "20",
        "Z": "-5",
    },
    "fastac registers BUNDLE -o FOLDER": {"BUNDLE": "build/paper"},
    "fastac scope SCENE": {"SCENE": "scenes/paper.toml"},
    "fastac verilog BUNDLE": {"BUNDLE": "build/paper"},
    "fastac bench driver FOLDER": {"FOLDER": "build/paper"},
}
"""Commands that are run as the pages have them, with what stands for their placeholders."""
WITH_VERILOG = ("fastac verilog BUNDLE", "fastac bench driver FOLDER")
"""Those that take long, one after another: the second needs what the first writes."""
PLACEHOLDER = re.compile(r"^[A-Z][A-Z_]*(\.\w+)?$")
SIGNS = "[]…|"


def blocks() -> list[Documented]:
    return [command for page in PAGES for command in shell_lines(page)]


def sentences() -> list[Documented]:
    return [command for page in PAGES for command in in_sentences(page)]


def resolved(words: tuple[str, ...]) -> tuple[str, click.Command, list[str]]:
    """The name, the click command and the rest of a command of ours."""
    command, rest, name = main, list(words[1:]), [words[0]]
    while isinstance(command, click.Group) and rest:
        inside = command.get_command(click.Context(command), rest[0])
        if inside is None:
            break
        name.append(rest.pop(0))
        command = inside
    return " ".join(name), command, rest


HELP = main.context_settings["help_option_names"]
"""A command keeps the help option of the first context that asks for it."""


def options_of(command: click.Command) -> set[str]:
    context = click.Context(command, help_option_names=HELP)
    parameters = command.get_params(context)
    return {option for one in parameters for option in (*one.opts, *one.secondary_opts)}


@pytest.mark.parametrize("documented", [c for c in blocks() if c.words[0] == "fastac"], ids=str)
def test_a_command_in_a_block_is_accepted(documented):
    """By click, as it is written: all its options exist, have values of their kinds, and none is missing."""
    name, command, rest = resolved(documented.words)
    context = click.Context(command, info_name=name, help_option_names=HELP)
    given, _, _ = command.make_parser(context).parse_args(list(rest))
    missing = [p.name for p in command.params if p.required and given.get(p.name) is None]
    assert missing == []
    if not any(PLACEHOLDER.match(word) for word in rest):
        command.make_context(name, list(rest), help_option_names=HELP)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_options_that_sentences_name_exist(page):
    for documented in (c for c in in_sentences(page) if c.words[0] == "fastac"):
        _, command, rest = resolved(documented.words)
        named = {word.strip(SIGNS).partition("=")[0] for word in rest if word.strip(SIGNS).startswith("-")}
        known = options_of(command) | ({"--help"} if "COMMAND" in rest else set())
        assert named - known == set(), documented


def test_recipes_of_the_makefile_name_options_that_exist():
    recipes = re.findall(r"\$\(FASTAC\) (.+)", (ROOT / "Makefile").read_text())
    assert recipes
    for recipe in recipes:
        words = re.sub(r"\|\|.*|;.*", "", recipe).replace("\\", "").split()
        _, command, _ = resolved(("fastac", *words))
        assert not isinstance(command, click.Group), recipe
        assert set(re.findall(r"--[a-z-]+", recipe)) - options_of(command) == set(), recipe


def test_targets_and_variables_of_make_exist():
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    variables = set(re.findall(r"^([A-Z]+) [?:]?=", makefile, re.MULTILINE))
    for documented in (c for c in [*blocks(), *sentences()] if c.words[0] == "make"):
        for word in documented.words[1:]:
            name, is_variable, _ = word.partition("=")
            assert name in (variables if is_variable else targets), documented


def test_something_runs_every_command():
    known = set(RUN_BY) | {resolved(shlex.split(text))[0] for text in WRITTEN}
    known |= {resolved(documented.words)[0] for documented in blocks() if documented.needs}
    for documented in blocks():
        if documented.needs or documented.text in WRITTEN:
            continue
        name = resolved(documented.words)[0] if documented.words[0] == "fastac" else None
        assert (name or " ".join(documented.words[:2])) in known, (
            f"{documented}: name a test of it in run_by.toml, or write <!-- needs: … --> above it"
        )
    for documented in (c for c in sentences() if c.words[0] == "fastac"):
        name, command, _ = resolved(documented.words)
        if not isinstance(command, click.Group):
            assert name in known, f"{documented}: name a test of it in run_by.toml"


@pytest.mark.parametrize("identity", sorted(set(RUN_BY.values())))
def test_what_runs_them_exists(identity):
    file, _, name = identity.partition("::")
    text = (ROOT / file).read_text()
    assert re.search(rf"^\s*def {name}\(" if name else "make test-all", text, re.MULTILINE)


@pytest.fixture(scope="module")
def place(tiny_toml, tiny_folder, tiny_file, tmp_path_factory) -> Path:
    """A folder like that of the project after two builds, of a sensor of 16×16 pixels."""
    folder = tmp_path_factory.mktemp("place")
    (folder / "scenes").mkdir()
    (folder / "scenes" / "paper.toml").write_text(tiny_toml.replace('"tiny"', '"paper"'))
    for name in ("paper", "new"):
        shutil.copytree(tiny_folder, folder / "build" / name)
        shutil.copy(tiny_file, folder / "build" / name / "data.h5")
    return folder


@pytest.mark.parametrize("text", [text for text in WRITTEN if text not in WITH_VERILOG])
def test_commands_run_as_they_are_written(text, place, monkeypatch):
    monkeypatch.chdir(place)
    run_as_written(text)


@pytest.mark.full
def test_commands_with_verilog_run_as_they_are_written(place, monkeypatch):
    monkeypatch.chdir(place)
    for text in WITH_VERILOG:
        run_as_written(text)


def run_as_written(text: str) -> None:
    """Run a command of `WRITTEN` in the current folder; it must still be in some page."""
    documented = {command.text.rstrip("…") for command in (*blocks(), *sentences())}
    assert text in documented, "no page has this command any more"
    stands_for = {"FILE": "file.out", "FOLDER": "folder.out"} | WRITTEN[text]
    words = [stands_for.get(word, word) for word in shlex.split(text)]
    succeed(*words[1:])
