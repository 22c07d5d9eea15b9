"""What makes the steps of a real build stale, told by editing a copy of the sources; nothing is trained."""

import shutil
from pathlib import Path

import pytest

import fastac
from fastac.flow import steps
from fastac.store.closure import Code

STEPS = {
    name: f"fastac.flow.steps:{name}"
    for name in (
        *("data", "normals", "integers", "force", "bundle"),
        *("evaluate", "verilog", "simulate", "report"),
    )
}
TRAINED = {"normals", "integers", "force", "bundle"}


def copied(folder: Path) -> Path:
    """A copy of the package, its linked folders as folders."""
    package = Path(fastac.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__", "*.npz", "*.h5")
    return shutil.copytree(package, folder / "fastac", symlinks=False, ignore=ignored)


@pytest.fixture
def sources(tmp_path) -> Path:
    return copied(tmp_path)


@pytest.fixture(scope="module")
def before(tmp_path_factory) -> dict[str, str]:
    """The digests of the sources as they are."""
    return digests(copied(tmp_path_factory.mktemp("unedited")))


def digests(sources: Path) -> dict[str, str]:
    code = Code({"fastac": sources})
    return {name: code.closure(function).digest for name, function in STEPS.items()}


def test_the_steps_are_those_of_the_module():
    for name, function in STEPS.items():
        assert function.endswith(f":{getattr(steps, name).__name__}")


ALL = set(STEPS)
HARMLESS = {
    "a docstring": ("models/integer/words.py", '"""', '"""In other words: '),
    "a comment": ("models/integer/words.py", "\n\n\n", "\n\n\n# A comment.\n"),
    "a new function": ("models/integer/network.py", "\n\n\n", "\n\n\ndef new():\n    pass\n\n\n"),
    "a new key": (
        "scenes/model_schema.py",
        "class Force(Strict):",
        "class Force(Strict):\n    new: int = 3",
    ),
    "a rule, whose values count": (
        "scenes/model_schema.py",
        "return self.gradient_fraction_bits +",
        "return 1 + self.gradient_fraction_bits +",
    ),
}
"""Edits that make no step stale: {what: (file, old text, new text)}."""
EDITS = {
    "rounding, three imports away": (
        "models/integer/words.py",
        "return (a + half_unit(shift, rounding)) >> shift",
        "return a >> shift",
        {"force", "bundle", "evaluate", "verilog", "simulate"},
        {"data", "normals"},
    ),
    "light": ("sensor/optics/light.py", "return ", "return 2 * ", {"data"}, ALL - {"data"}),
    "a pipeline's depth": (
        "gateware/arithmetic/product.py",
        "LATENCY = 3",
        "LATENCY = 4",
        {"verilog"},
        {"data", "evaluate", *TRAINED},
    ),
    "a bench": ("sim/benches/top.py", "LINGER = ", "LINGER = 1 + ", {"simulate"}, ALL - {"simulate"}),
    "the linter's waivers": (
        "gateware/target/lint.vlt",
        "`verilator_config",
        "`verilator_config\n",
        {"verilog"},
        {"data", *TRAINED},
    ),
}


"""{what: (file, old text, new text, steps that become stale, steps that do not)}."""


def replace_in(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.full
def test_harmless_edits_stale_nothing(sources, before):
    for file, old, new in HARMLESS.values():
        replace_in(sources / file, old, new)
    assert digests(sources) == before


@pytest.mark.parametrize("edit", EDITS)
@pytest.mark.quick("rounding, three imports away")
def test_an_edit_stales_what_it_can_change(sources, before, edit):
    file, old, new, stale, untouched = EDITS[edit]
    replace_in(sources / file, old, new)
    after = digests(sources)
    changed = {name for name in STEPS if before[name] != after[name]}
    assert stale <= changed
    assert not changed & untouched
