"""The parts of the LeRobot package that do without LeRobot, imported from its folder."""

import sys
import types
from importlib import import_module
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[3] / "integrations" / "lerobot" / "lerobot_camera_fastac"
NAME = "lerobot_camera_fastac_without_lerobot"


@pytest.fixture(scope="session")
def part():
    """`part("messages")`: a module of the package, whose `__init__.py`, which imports LeRobot, is not run."""
    package = types.ModuleType(NAME)
    package.__path__ = [str(FOLDER)]
    sys.modules[NAME] = package
    yield lambda name: import_module(f"{NAME}.{name}")
    for name in [name for name in sys.modules if name.split(".")[0] == NAME]:
        del sys.modules[name]


@pytest.fixture(scope="session")
def messages(part):
    return part("messages")
