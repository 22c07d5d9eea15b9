import importlib.metadata

import pytest

from fastac.store import libraries
from fastac.store.libraries import Libraries


@pytest.fixture(autouse=True)
def _nothing_remembered():
    libraries._required.cache_clear()
    yield
    libraries._required.cache_clear()


def test_requirements_are_included():
    found = Libraries("fastac").versions({"pydantic", "os"})
    assert found["pydantic"] == importlib.metadata.version("pydantic")
    assert found["pydantic-core"] == importlib.metadata.version("pydantic-core")
    assert "pytest" not in found


def test_extras_are_included_where_the_project_asks_for_them(monkeypatch):
    requires = {
        "project": ["pydantic[more]>=2"],
        "pydantic": ["numpy; extra == 'more'", "h5py; extra == 'x'"],
    }

    class Distribution:
        version = "1"

        def __init__(self, name):
            self.requires = requires.get(name)

    monkeypatch.setattr(importlib.metadata, "distribution", Distribution)
    assert set(Libraries("project").versions({"pydantic"})) == {"pydantic", "numpy"}
    assert set(Libraries("other").versions({"pydantic"})) == {"pydantic"}


def test_what_is_not_installed_is_named():
    assert Libraries("fastac").versions({"no_such_library"}) == {"no-such-library": "missing"}
