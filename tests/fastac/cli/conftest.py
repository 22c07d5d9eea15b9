import os

import pytest


@pytest.fixture
def toml(tiny_toml, tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(tiny_toml)
    return path


@pytest.fixture
def one_process(monkeypatch):
    """Frames without worker processes: a few presses are not worth their start."""
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
