"""Paths to write are checked before any work; every command shows how it is called."""

import os
import shlex

import click
import pytest
from click.testing import CliRunner

from fastac.cli.common import Output
from fastac.cli.main import main


def commands(group: click.Group, words: tuple[str, ...] = ()):
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands(command, (*words, name))
        else:
            yield (*words, name), command


ALL = dict(commands(main))
WRITING = [
    (words, option.opts[0], option.type.kind)
    for words, command in ALL.items()
    for option in command.params
    if isinstance(option.type, Output)
]


def refused(words, option, path) -> str:
    """The one line that a command ends with, given only this option: what else is missing is not reached."""
    result = CliRunner().invoke(main, [*words, option, str(path)])
    assert result.exit_code == 1, result.output
    assert len(result.stderr.splitlines()) == 1
    return result.stderr.removeprefix("Error: ").strip()


def test_every_output_option_has_the_checked_type():
    outputs = [p for command in ALL.values() for p in command.params if "--output" in p.opts]
    assert len(outputs) >= 18
    assert all(isinstance(option.type, Output) for option in outputs)


@pytest.mark.parametrize(("words", "option", "kind"), WRITING)
def test_a_path_of_the_wrong_kind_is_refused_first(words, option, kind, tmp_path):
    (tmp_path / "file").write_text("")
    below = tmp_path / "file" / "below"
    assert refused(words, option, below) == f"{below}: {tmp_path / 'file'} is a file, not a folder"
    if kind == "file":
        assert refused(words, option, tmp_path) == f"{tmp_path}: is a folder; give the name of a file"
    else:
        message = f"{tmp_path / 'file'}: is a file; give the name of a folder"
        assert refused(words, option, tmp_path / "file") == message


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_folder_that_cannot_be_written_is_refused(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path)
    with pytest.raises(click.ClickException, match=r"new/x: folder .* cannot be written"):
        Output(kind).convert(str(tmp_path / "new" / "x"), None, None)


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_folders_on_the_way_need_not_exist_and_are_not_made(kind, tmp_path):
    path = tmp_path / "new" / "deep" / "x"
    assert Output(kind).convert(str(path), None, None) == path
    assert not (tmp_path / "new").exists()


def test_an_existing_output_may_be_replaced(tmp_path):
    (tmp_path / "old").write_text("")
    assert Output("file").convert(str(tmp_path / "old"), None, None) == tmp_path / "old"
    assert Output("folder").convert(str(tmp_path), None, None) == tmp_path


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_help_ends_with_an_example_that_the_command_accepts(words, monkeypatch):
    """The example names only options that there are, and all that are required."""
    example = shlex.split(ALL[words].help.partition("Example: ")[2])
    assert example[: 1 + len(words)] == ["fastac", *words]
    seen = []
    monkeypatch.setattr(ALL[words], "callback", lambda **given: seen.append(given))
    result = CliRunner().invoke(main, example[1:])
    assert result.exit_code == 0, result.output
    assert len(seen) == 1
