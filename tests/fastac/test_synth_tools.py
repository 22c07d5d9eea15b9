"""Tools of other makers: their versions, their errors, their time."""

import tomllib
from pathlib import Path

import pytest

from fastac import synth_tools
from fastac.synth_tools import OutOfTimeError, SynthError

ROOT = Path(__file__).resolve().parents[2]


def test_tool_that_fails(tmp_path, monkeypatch):
    monkeypatch.setitem(synth_tools.ENTRY, "tool", "print('Info: 1'); print('ERROR: 2 wires'); exit(3)")
    with pytest.raises(SynthError, match=r"^tool: ERROR: 2 wires$"):
        synth_tools.run("tool", [], tmp_path)
    monkeypatch.setitem(synth_tools.ENTRY, "tool", "while True: pass")
    monkeypatch.setattr(synth_tools, "TIME_LIMIT_S", 1)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 1 s of processor time$"):
        synth_tools.run("tool", [], tmp_path)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 2 s of processor time$"):
        synth_tools.run("tool", [], tmp_path, limit_s=2)


def test_versions_are_those_of_the_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert sorted(project["optional-dependencies"]["synth"]) == sorted(
        f"{name}=={version}" for name, version in synth_tools.VERSIONS.items()
    )
