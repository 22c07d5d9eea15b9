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


@pytest.fixture
def sources(tmp_path) -> Path:
    """A copy of the package, its linked folders as folders."""
    package = Path(fastac.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__", "*.npz", "*.h5")
    return shutil.copytree(package, tmp_path / "fastac", symlinks=False, ignore=ignored)


def digests(sources: Path) -> dict[str, str]:
    code = Code({"fastac": sources})
    return {name: code.closure(function).digest for name, function in STEPS.items()}


def test_the_steps_are_those_of_the_module():
    for name, function in STEPS.items():
        assert function.endswith(f":{getattr(steps, name).__name__}")


NOTHING = set(STEPS)
"""Steps that an edit must leave alone: all."""
EDITS = {
    "a docstring": ("models/integer/words.py", '"""', '"""In other words: ', set(), NOTHING),
    "a comment": ("models/integer/words.py", "\n\n\n", "\n\n\n# A comment.\n", set(), NOTHING),
    "a new function": (
        "models/integer/words.py",
        "\n\n\n",
        "\n\n\ndef new():\n    pass\n\n\n",
        set(),
        NOTHING,
    ),
    "a new key": (
        "scenes/model_schema.py",
        "class Force(Strict):",
        "class Force(Strict):\n    new: int = 3",
        set(),
        NOTHING,
    ),
    "a rule, whose values count": (
        "scenes/model_schema.py",
        "return self.gradient_fraction_bits +",
        "return 1 + self.gradient_fraction_bits +",
        set(),
        NOTHING,
    ),
    "rounding, three imports away": (
        "models/integer/words.py",
        "return (a + half_unit(shift, rounding)) >> shift",
        "return a >> shift",
        {"force", "bundle", "evaluate", "verilog", "simulate"},
        {"data", "normals"},
    ),
    "light": ("sensor/optics/light.py", "return ", "return 2 * ", {"data"}, NOTHING - {"data"}),
    "a pipeline's depth": (
        "gateware/arithmetic/product.py",
        "LATENCY = 3",
        "LATENCY = 4",
        {"verilog"},
        {"data", "evaluate", *TRAINED},
    ),
    "a bench": ("sim/benches/top.py", "LINGER = ", "LINGER = 1 + ", {"simulate"}, NOTHING - {"simulate"}),
    "the linter's waivers": (
        "gateware/target/lint.vlt",
        "`verilator_config",
        "`verilator_config\n",
        {"verilog"},
        {"data", *TRAINED},
    ),
}


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_stales_what_it_can_change(sources, edit):
    file, old, new, stale, untouched = EDITS[edit]
    before, path = digests(sources), sources / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    after = digests(sources)
    changed = {name for name in STEPS if before[name] != after[name]}
    assert stale <= changed
    assert not changed & untouched
