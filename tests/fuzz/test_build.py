"""Damaged files in a build folder, from which `fastac report` makes its page."""

import json
import tempfile
from functools import cache
from pathlib import Path

import fuzzing
import pytest
from fuzzing import Case, Reader
from hypothesis import strategies as st
from mutations import texts
from packet_hardware import packet_hardware
from vivado_texts import HIERARCHY, LITEX_TIMING, POWER, ULTRASCALE_UTILISATION

from fastac.models import random_bundle
from fastac.models.integer.bundle import Bundle
from fastac.report.content import content, summary_rows
from fastac.synth import vivado_reports
from fastac.synth.synthesis import FILE

ERRORS = {"depth_mae_mm": 0.01, "force_z_mae_n": 0.02}
HASHES = {"bundle_sha256": "a", "rtlil_sha256": "b"}
FILES = {
    "accuracy.json": {
        "frames": 8,
        "float": ERRORS,
        "integer": ERRORS,
        "growth_percent": {"depth_mae_mm": 1.5},
        "saturated_values": {"slopes": 0},
    },
    "sim.json": {
        "latency_cycles": {"first_pixel_to_force": 100, "initiation_interval": 80},
        "frames": 3,
        "values_compared": 1000,
        "mismatches": 0,
        "values_by_output": {"depth": 1000},
        "markers_compared": 9,
        "frame_indices": [0, 3, 7],
        "errors": {"overrun": 0},
    },
    "verilog/hardware.json": {
        "multipliers": {"mlp": 10, "dst": 4},
        "latency_cycles_by_formula": {"stage": {"mlp": 5}},
        **HASHES,
    },
    FILE: {
        **HASHES,
        "totals": {"lut": {"value": 900, "origin": "counted"}},
        "modules": {"mlp": {"instances": ["a"]}},
    },
    vivado_reports.FILE: {
        "tool": "v.2023.2",
        "part": "xczu19eg-ffvc1760-2-i",
        "streams": "packets",
        "scope": "the core",
        "figures": {"lut": {"value": 900, "origin": vivado_reports.ORIGIN}},
    },
}
FRAGMENTS = (b"[" * 100_000, b'{"a":' * 3000, b"9" * 5000, b"NaN", b"1e999", b"\xff", b"null", b",", b"}")


@cache
def bundle() -> Bundle:
    with tempfile.TemporaryDirectory() as folder:
        outputs = ("normals", "depth", "force_z")
        return random_bundle.random_bundle(Path(folder) / "bundle", random_bundle.scene(outputs))


@st.composite
def builds(draw) -> Case:
    """A build folder of which one file is damaged or missing."""
    trees = dict(FILES)  # the bundle is made before a case is read
    trees[vivado_reports.FILE] = FILES[vivado_reports.FILE] | {"bundle_sha256": bundle().digest}
    files = {name: json.dumps(tree).encode() for name, tree in trees.items()}
    name = draw(st.sampled_from(tuple(FILES)))
    if draw(st.integers(0, 9)):
        files[name] = draw(texts([trees[name]], json.dumps, [files[name]], FRAGMENTS))
    else:
        del files[name]
    return files


def read(folder: Path) -> None:
    summary_rows(content(folder, bundle()))


@st.composite
def reports(draw) -> Case:
    """Reports of Vivado of which one is damaged, empty or missing."""
    files = {
        vivado_reports.UTILISATION: ULTRASCALE_UTILISATION,
        vivado_reports.HIERARCHY: HIERARCHY,
        vivado_reports.TIMING: LITEX_TIMING,
        vivado_reports.POWER: POWER,
    }
    name = draw(st.sampled_from(tuple(files)))
    lines = files[name].splitlines()
    for _ in range(draw(st.integers(1, 6))):
        k = draw(st.integers(0, len(lines) - 1))
        lines[k] = draw(st.sampled_from(("", lines[k][: len(lines[k]) // 2], lines[k] * 2, *REPORT_LINES)))
    files[name] = "\n".join(lines)
    return {key: text.encode() for key, text in files.items() if key != name or draw(st.integers(0, 9))}


REPORT_LINES = (
    "| Design Timing Summary",
    "| Clock Summary",
    "clk {0 1} 0.0 1 ",
    "clk {0 1} 1e999 1 ",
    "  NaN inf -1 " + "9" * 400,
    "| CLB LUTs | nan |",
    "| Instance |",
    "|" * 5000,
    "\x00\ufffd",
)
"""Lines that come in the place of others: of the wrong table, with numbers that are none."""


def collect(folder: Path) -> None:
    vivado_reports.collect(folder, packet_hardware(), instance="fastac_0")


READERS = [
    Reader("files of a build", builds(), read, count=10_000),
    Reader("reports of Vivado", reports(), collect, count=10_000),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
