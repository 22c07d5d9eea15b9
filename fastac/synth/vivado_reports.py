"""Figures out of Vivado's text reports: utilisation, timing and power of a routed design.

The formats are those of `report_utilization`, `report_timing_summary` and `report_power` (UG906, UG907), as
Vivado 2019.2 to 2023.2 writes them.
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from fastac.store.files import DamagedFileError, read_json, write_json

FILE = "vivado.json"
ORIGIN = "reported by Vivado"
UTILISATION, HIERARCHY = "utilization.rpt", "utilization_hierarchical.rpt"
TIMING, POWER = "timing.rpt", "power.rpt"
SITES = {
    "CLB LUTs": "lut",
    "Slice LUTs": "lut",
    "CLB Registers": "ff",
    "Slice Registers": "ff",
    "CARRY8": "carry8",
    "CARRY4": "carry4",
    "Block RAM Tile": "ramb36",
    "URAM": "uram288",
    "DSP48E2 only": "dsp48e2",
    "DSP48E1 only": "dsp48e1",
}
"""Names of the resources by Vivado's site types, of UltraScale+ and of the 7 series."""
COLUMNS = {"Total LUTs": "lut", "FFs": "ff", "URAM": "uram288", "DSP Blocks": "dsp", "DSP48 Blocks": "dsp"}
"""The same by the columns of the hierarchical report; RAMB18 count half a RAMB36."""
POWERS = {
    "Total On-Chip Power (W)": "total_w",
    "Dynamic (W)": "dynamic_w",
    "Device Static (W)": "static_w",
}


class ReportError(ValueError):
    """Vivado's reports cannot be used; the message is one line that names the file."""


class _Figure(TypedDict):
    value: Annotated[float, Field(ge=-1e12, le=1e12)]
    origin: str


class _Content(TypedDict):
    """What of vivado.json the report takes over."""

    bundle_sha256: str
    tool: str
    part: str
    streams: Literal["packets", "video"]
    scope: str
    figures: dict[str, _Figure]


_CONTENT = TypeAdapter(_Content)


def tables(text: str) -> Iterator[list[str]]:
    """The rows of all tables with vertical bars, as their cells."""
    for line in text.splitlines():
        if line.startswith("|"):
            yield [cell.strip() for cell in line.strip().strip("|").split("|")]


def heading(text: str, key: str) -> str:
    """An entry of a report's heading, such as "Tool Version"; empty where there is none."""
    found = re.search(rf"^\| {re.escape(key)}\s*: (.*?)\s*$", text, re.MULTILINE)
    return found[1] if found else ""


def utilisation(text: str) -> dict[str, float]:
    """Used resources by their names; those whose rows are absent are absent."""
    found: dict[str, float] = {}
    for cells in tables(text):
        name = SITES.get(cells[0].rstrip("*"))
        if name is not None and len(cells) > 1 and name not in found:
            number = _number(cells[1])
            if number is not None:
                found[name] = number
    return found


def hierarchical(text: str, instance: str) -> dict[str, float]:
    """The resources of one instance with all below it, by the hierarchical report; empty if it is not there.

    `dsp` counts DSP slices of whichever kind the device has.
    """
    columns: list[str] = []
    for cells in tables(text):
        if cells[0] == "Instance":
            columns = cells
        elif columns and cells[0] == instance and len(cells) == len(columns):
            row = {key: _number(cell) for key, cell in zip(columns, cells, strict=True)}
            found = {name: row[key] for key, name in COLUMNS.items() if row.get(key) is not None}
            if row.get("RAMB36") is not None and row.get("RAMB18") is not None:
                found["ramb36"] = row["RAMB36"] + row["RAMB18"] / 2
            return found
    return {}


def timing(text: str) -> dict[str, float]:
    """Worst slacks, failing endpoints, and the clock that its period and the setup slack allow."""
    lines = _section(text, "Design Timing Summary")
    head = next((k for k, line in enumerate(lines) if line.split()[:1] == ["WNS(ns)"]), None)
    if head is None or head + 2 >= len(lines):
        return {}
    names = re.split(r" {2,}", lines[head].strip())
    values = dict(zip(names, map(_number, lines[head + 2].split()), strict=False))
    found = {
        "setup_slack_ns": values.get("WNS(ns)"),
        "hold_slack_ns": values.get("WHS(ns)"),
        "failing_endpoints": _sum(values.get("TNS Failing Endpoints"), values.get("THS Failing Endpoints")),
    }
    period, slack = _period(text), found["setup_slack_ns"]
    if period is not None and slack is not None and period > max(slack, 0):
        found["clock_mhz"] = round(1000 / period, 3)
        found["reachable_clock_mhz"] = round(1000 / (period - slack), 3)
    return {key: value for key, value in found.items() if value is not None}


def power(text: str) -> dict[str, float]:
    """Power in watts: total_w, dynamic_w, static_w."""
    found = {}
    for cells in tables(text):
        if len(cells) == 2 and cells[0] in POWERS:
            number = _number(cells[1])
            if number is not None:
                found[POWERS[cells[0]]] = number
    return found


def confidence(text: str) -> str:
    """How far Vivado trusts its estimate of the power: "Low", "Medium", "High", or empty."""
    return next(
        (cells[1] for cells in tables(text) if cells[0] == "Confidence Level" and len(cells) == 2), ""
    )


def _number(text: str) -> float | None:
    """None for what is no finite number: "NA", "Unspecified*", empty cells."""
    try:
        number = float(text.lstrip("<"))
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _sum(*numbers: float | None) -> float | None:
    return sum(numbers) if None not in numbers else None


def _section(text: str, title: str) -> list[str]:
    """The lines of a section that are not empty, up to the heading of the next one."""
    lines = iter(text.splitlines())
    found = []
    if any(line.strip() == f"| {title}" for line in lines):
        for line in lines:
            if line.startswith("| ") and not line.startswith("| -"):
                break
            found += [line] if line.strip() else []
    return found


def _period(text: str) -> float | None:
    """Of the first clock of the summary, ns: our designs have one."""
    for line in _section(text, "Clock Summary"):
        if clock := re.match(r"\s*\S+ +\{[^{}]*\} +([\d.]+) ", line):
            return _number(clock[1])
    return None


def collect(folder: Path, hardware: Mapping, *, instance: str | None) -> dict:
    """The content of vivado.json from the reports in `folder`; raises ReportError where none is usable.

    hardware : content of the hardware.json that the reports belong to
    instance : of the core in the block design; None where the core is the whole design
    """
    texts = {}
    for name in (UTILISATION, HIERARCHY, TIMING, POWER):
        path = folder / name
        if path.exists():
            texts[name] = path.read_text(encoding="utf-8", errors="replace")
    for name in (UTILISATION, TIMING):
        if name not in texts:
            raise ReportError(f"{folder / name}: no such report: run build.tcl in Vivado first")
    device = heading(texts[UTILISATION], "Device")
    if device and not _same(device, hardware["part"]):
        raise ReportError(f"{folder / UTILISATION}: Device {device}: expected {hardware['part']}")
    figures = utilisation(texts[UTILISATION]) | timing(texts[TIMING]) | power(texts.get(POWER, ""))
    if "lut" not in figures or "setup_slack_ns" not in figures:
        name = UTILISATION if "lut" not in figures else TIMING
        raise ReportError(f"{folder / name}: no figures were found in it: is it Vivado's report?")
    if instance is not None:
        of_core = hierarchical(texts.get(HIERARCHY, ""), instance)
        figures |= {f"core_{name}": value for name, value in of_core.items()}
    return {
        "bundle_sha256": hardware["bundle_sha256"],
        "rtlil_sha256": hardware["rtlil_sha256"],
        "tool": heading(texts[UTILISATION], "Tool Version").removeprefix("Vivado "),
        "part": hardware["part"],
        "streams": hardware["streams"],
        "scope": "the core, out of context"
        if instance is None
        else "the whole block design; core_...: the core",
        "power_confidence": confidence(texts.get(POWER, "")),
        "figures": {name: {"value": value, "origin": ORIGIN} for name, value in figures.items()},
    }


def _same(device: str, part: str) -> bool:
    """Whether a report's "Device", such as xczu7ev-ffvc1156 or 7z020clg400-1, is this part."""
    plain = [re.sub(r"[^a-z0-9]", "", name.lower()).removeprefix("xc") for name in (device, part)]
    return bool(plain[0]) and plain[1].startswith(plain[0])


def read(folder: Path, bundle_sha256: str) -> dict:
    """What report.json says of Vivado: vivado.json in `folder`; empty where there is none of this bundle."""
    path = folder / FILE
    if not path.exists():
        return {}
    content = read_json(path)
    try:
        _CONTENT.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise DamagedFileError(f"{path}: {key}: {first['msg']}") from None
    return content if content["bundle_sha256"] == bundle_sha256 else {}


def write(content: dict, build: Path) -> Path:
    """Write vivado.json into the build folder; returns its path."""
    write_json(build / FILE, content)
    return build / FILE
