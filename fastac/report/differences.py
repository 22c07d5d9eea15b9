"""What differs between two finished builds: keys of their scenes, errors, cycles, resources, energy."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NotRequired

from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from fastac.report.tables import Table, number
from fastac.scenes.pace import PixelsPerClock
from fastac.scenes.schema import AXES
from fastac.store.files import DamagedFileError, read_json

REPORT = "report.json"
ABSENT = "–"
INTEGERS, CYCLES, RESOURCES, ENERGY = "Errors of the integers", "Cycles", "Resources", "Energy"
"""Sections of figures that a page shows first."""
COUNTED = (
    "first_pixel_to_force",
    "last_pixel_to_force",
    "first_pixel_to_depth",
    "first_pixel_to_normals",
    "initiation_interval",
)
MEANS = ("force_mae_n", "force_rmse_n", "force_nmae_percent", "force_r2")
"""Errors of the force that are means over the axes, if there are several."""
FEW = 10
"""Ratios from here on are shown as such, not in percent."""
Finite = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=10**12)]


class _Stated(TypedDict):
    value: object


class _Vivado(TypedDict):
    figures: dict[str, _Stated]


class _Sensor(TypedDict):
    height_px: Annotated[int, Field(gt=2, le=10**5)]
    width_px: Annotated[int, Field(gt=2, le=10**5)]


class _Pace(TypedDict):
    pixels_per_clock: PixelsPerClock


class _Hardware(_Pace):
    clock_mhz: Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Scene(TypedDict):
    name: str
    outputs: list[str]
    sensor: _Sensor
    hardware: _Hardware


class _Compared(TypedDict):
    values_compared: Count
    mismatches: Count


class _Accuracy(TypedDict):
    float: dict[str, Finite]
    integer: dict[str, Finite]


class _Formula(TypedDict):
    stage: Annotated[dict[str, Count], Field(min_length=1)]


class _Report(TypedDict):
    """What is compared; whatever else a report has is left alone."""

    scene: _Scene
    bundle_sha256: str
    data: dict[str, object]
    frames_are: str
    latency_cycles: dict[str, object]
    latency_cycles_by_formula: _Formula
    rtl_vs_integer: _Compared
    accuracy: _Accuracy
    resources: dict[str, _Stated]
    pace: NotRequired[_Pace]
    energy_estimate_uj_per_frame: NotRequired[_Stated]
    vivado: NotRequired[_Vivado]


_REPORT = TypeAdapter(_Report)


@dataclass(frozen=True)
class Finished:
    """A finished build: its folder's name and the content of its report.json."""

    name: str
    report: dict


def read(folder: Path) -> Finished:
    """The build in a folder.

    Raises FileNotFoundError or DamagedFileError, one line that names folder or file, where it is no finished
    build.
    """
    path = folder / REPORT
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder; give the folder of a finished build")
    if not path.exists():
        raise FileNotFoundError(f"{folder}: no {REPORT} in it: no finished build; fastac build makes one")
    content = read_json(path)
    try:
        _REPORT.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise DamagedFileError(f"{path}: {key or 'content'}: {first['msg']}") from None
    return Finished(folder.resolve().name, content)


@dataclass(frozen=True)
class Difference:
    """One figure of both builds, None where a build has none; `better` is -1 where less is better, 1 where
    more is, 0 where neither is."""

    name: str
    a: float | None
    b: float | None
    better: int = -1

    @property
    def relative(self) -> str:
        """How far b is from a: in percent, or as a ratio where one is many times the other."""
        if self.a is None or self.b is None:
            return ""
        if self.a == self.b:
            return "="
        if self.a <= 0 or self.b < 0:
            return f"{self.b - self.a:+.4g}"
        ratio = self.b / self.a
        return f"× {ratio:.3g}" if ratio >= FEW or 0 < ratio <= 1 / FEW else f"{100 * (ratio - 1):+.1f}%"

    @property
    def verdict(self) -> str:
        """ "good" where b is better than a, "bad" where it is worse, else ""."""
        if self.a is None or self.b is None or self.a == self.b or not self.better:
            return ""
        return "good" if (self.b > self.a) == (self.better > 0) else "bad"

    @property
    def cells(self) -> list[str]:
        values = [ABSENT if value is None else number(value) for value in (self.a, self.b)]
        return [self.name, *values, self.relative]


def scene_table(a: Finished, b: Finished, names: tuple[str, str]) -> Table:
    """The keys of the scenes whose values differ; a key that a scene does not have is shown as absent."""
    keys = [dict(_flat(build.report["scene"])) for build in (a, b)]
    rows = [
        [key, *(_value(each[key]) if key in each else ABSENT for each in keys)]
        for key in dict.fromkeys([*keys[0], *keys[1]])
        if keys[0].get(key, ABSENT) != keys[1].get(key, ABSENT)
    ]
    return Table("The scenes", ["key", *names], rows, "" if rows else "No key of the scenes differs.")


def _flat(content: Mapping, before: str = "") -> Iterator[tuple[str, object]]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _value(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(_value, value))
    return "unset" if value is None else str(value)


def figures(a: Finished, b: Finished) -> dict[str, list[Difference]]:
    """All figures of both builds by section; sections that neither has are left out."""
    parts = [_sections(build.report) for build in (a, b)]
    found = {}
    for title in parts[0]:
        values = [part[title] for part in parts]
        names = dict.fromkeys([*values[0], *values[1]])
        rows = [Difference(n, values[0].get(n), values[1].get(n), _better(n)) for n in names]
        if rows:
            found[title] = rows
    return found


def _better(name: str) -> int:
    if name.endswith(("_r2", "clock_mhz")):
        return 1
    return 0 if name == "values compared" or "registers" in name else -1


def _sections(report: dict) -> dict[str, dict[str, float]]:
    rtl, cycles = report["rtl_vs_integer"], report["latency_cycles"]
    energy = {"estimated µJ a frame": report.get("energy_estimate_uj_per_frame", {"value": None})}
    return {
        INTEGERS: _errors(report, "integer"),
        "Errors of the floats": _errors(report, "float"),
        CYCLES: {key.replace("_", " "): cycles[key] for key in COUNTED if _is_number(cycles.get(key))},
        "What each stage adds, cycles": report["latency_cycles_by_formula"]["stage"],
        RESOURCES: _values(report["resources"]),
        "Resources, Vivado": _values(report["vivado"]["figures"] if "vivado" in report else {}),
        ENERGY: _values(energy),
        "Hardware against integers": {
            "mismatches": rtl["mismatches"],
            "values compared": rtl["values_compared"],
        },
    }


def _errors(report: dict, pipeline: str) -> dict[str, float]:
    """The errors of a pipeline. With one axis of force they are named after it, like those of several axes:
    a mean over other axes would be no match for it."""
    errors = report["accuracy"][pipeline]
    axes = {name.removeprefix("force_") for name in report["scene"]["outputs"]} & set(AXES)
    if len(axes) != 1:
        return errors
    of_axis = f"force_{axes.pop()}_"
    return {
        of_axis + key.removeprefix("force_") if key in MEANS else key: value for key, value in errors.items()
    }


def _values(figures: Mapping[str, Mapping]) -> dict[str, float]:
    """The numbers of figures with their origin; of figures by module those of each module."""
    found = {}
    for key, figure in figures.items():
        value = figure["value"]
        parts = {key: value} if not isinstance(value, dict) else {f"{key}, {n}": v for n, v in value.items()}
        found |= {name: part for name, part in parts.items() if _is_number(part)}
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def caution(a: Finished, b: Finished) -> str:
    """A sentence where the errors of the two builds cannot be compared as they are, else nothing."""
    one, two = a.report, b.report
    if one["frames_are"] != two["frames_are"]:
        return f"Errors are on different frames: {one['frames_are']} and {two['frames_are']}."
    same = all(one["scene"].get(key) == two["scene"].get(key) for key in ("sensor", "protocol"))
    if not same or one["data"] != two["data"]:
        return f"Errors are on different {one['frames_are']} frames: sensor, protocol or recording differ."
    return ""
