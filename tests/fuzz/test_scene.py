"""Damaged scenes and specifications of sweeps."""

import tomllib
from datetime import date, time
from pathlib import Path

import fuzzing
import pytest
import tomli_w
from fuzzing import Reader
from hypothesis import strategies as st
from mutations import NASTY, texts

from fastac.scenes import schema
from fastac.sweep import spec

ROOT = Path(__file__).parents[2]
SCENES = [path.read_bytes() for path in sorted((ROOT / "scenes").glob("*.toml"))]
SPEC = b"""\
scene = "base.toml"
method = "grid"
frames = 4

[axes]
"numbers.data_bits" = [18, 22]
"hardware.pixels_per_clock" = [1, 4]
"numbers.weight_bits, numbers.activation_bits" = [8, [6, 5]]
"""
BASES = SPEC + b'scene = ["base.toml", "other.toml"]\n'
SPECS = [
    SPEC,
    BASES,
    SPEC.replace(b"[axes]", b"[[axes]]"),
    SPEC.replace(b'"grid"', b'"optuna"\nobjectives = ["dsp"]'),
]
FRAGMENTS = (
    b"[" * 3000,
    b"x = " + b"[" * 2000 + b"]" * 2000,
    b"a." * 3000,
    b'"""',
    b"'''",
    b"\xff\xfe",
    b"\xed\xa0\x80",
    b"9" * 5000,
    b"0x" + b"f" * 5000,
    b"1e999",
    b"nan",
    b"1979-05-27T07:32:00Z",
    b"\n[sensor]\n",
    b"\n[[axes]]\n",
    b" = ",
    b"\\u0000",
    b"#",
)

VALUES = (
    *(value for value in NASTY if "hostname" not in repr(value)),  # a specification may name any scene
    date(1979, 5, 27),
    time(7, 32),
    16,
    4,
    1.0,
    "fem",
    "adjoint",
    "tridiagonal",
    "slopes",
    "force_xyz",
)


def dumped(tree: dict) -> str:
    """TOML that need not be valid: what `tomli_w` refuses is written as Python would."""
    try:
        return tomli_w.dumps(tree)
    except (TypeError, ValueError, RecursionError):
        return repr(tree)


def files(samples: list[bytes]) -> st.SearchStrategy[bytes]:
    return texts([tomllib.loads(text.decode()) for text in samples], dumped, samples, FRAGMENTS, VALUES)


def read_spec(folder: Path) -> None:
    """As `fastac sweep` does before it measures anything, of the first points."""
    content, base = spec.load(folder / "spec.toml")
    if content.method == "grid":
        for _, _ in zip(range(20), spec.grid(content, base, folder), strict=False):
            pass


READERS = [
    Reader(
        "scene",
        files(SCENES).map(lambda text: {"scene.toml": text}),
        lambda folder: schema.load(folder / "scene.toml"),
        command=lambda folder: ["build", folder / "scene.toml", "--why"],
    ),
    Reader(
        "sweep's specification",
        files(SPECS).map(lambda text: {"spec.toml": text, "base.toml": SCENES[0], "other.toml": SCENES[1]}),
        read_spec,
        command=lambda folder: ["sweep", folder / "spec.toml", "-o", folder / "out" / "a.sqlite"],
    ),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
