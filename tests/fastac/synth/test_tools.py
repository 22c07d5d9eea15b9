"""Tools of other makers: their versions, their errors, their time."""

import tomllib
from pathlib import Path

import pytest

from fastac.synth import tools
from fastac.synth.tools import OutOfTimeError, SynthError

ROOT = Path(__file__).resolve().parents[3]


def test_tool_that_fails(tmp_path, monkeypatch):
    monkeypatch.setitem(tools.ENTRY, "tool", "print('Info: 1'); print('ERROR: 2 wires'); exit(3)")
    with pytest.raises(SynthError, match=r"^tool: ERROR: 2 wires$"):
        tools.run("tool", [], tmp_path)
    monkeypatch.setitem(tools.ENTRY, "tool", "while True: pass")
    monkeypatch.setattr(tools, "TIME_LIMIT_S", 1)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 1 s of processor time$"):
        tools.run("tool", [], tmp_path)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 2 s of processor time$"):
        tools.run("tool", [], tmp_path, limit_s=2)


def test_versions_are_those_of_the_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert sorted(project["optional-dependencies"]["synth"]) == sorted(
        f"{name}=={version}" for name, version in tools.VERSIONS.items()
    )
