"""Tools of other makers: their versions, their errors, their time."""

import tomllib
from pathlib import Path

import pytest

from fastac.gateware.target import tools
from fastac.gateware.target.tools import OutOfTimeError, ToolError

ROOT = Path(__file__).resolve().parents[3]


def test_tool_that_fails(tmp_path, monkeypatch):
    monkeypatch.setitem(tools.ENTRY, "tool", "print('Info: 1'); print('ERROR: 2 wires'); exit(3)")
    with pytest.raises(ToolError, match=r"^tool: ERROR: 2 wires$"):
        tools.run("tool", [], tmp_path)
    monkeypatch.setitem(tools.ENTRY, "tool", "while True: pass")
    monkeypatch.setattr(tools, "TIME_LIMIT_S", 1)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 1 s of processor time$"):
        tools.run("tool", [], tmp_path)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 2 s of processor time$"):
        tools.run("tool", [], tmp_path, limit_s=2)


def test_versions_are_those_of_the_extras():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    pinned = {line for name in ("yosys", "proof", "synth") for line in extras[name] if "==" in line}
    assert pinned == {f"{name}=={version}" for name, version in tools.VERSIONS.items()}
