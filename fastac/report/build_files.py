"""The files of a build that its report is made of, checked as they are read."""

from pathlib import Path
from typing import Annotated, NotRequired, Required

from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from fastac.store.files import DamagedFileError, read_json

Count = Annotated[int, Field(ge=0, le=10**12)]
"""No build has more of anything, and a larger number need not fit a float."""


class _Covered(TypedDict):
    coverage: float
    coverage_from: float
    coverage_to: float
    half_width_n: float


class _Counted(TypedDict, total=False):
    groups: Required[Count]
    frames: Required[Count]
    x: _Covered
    y: _Covered
    z: _Covered


class _Intervals(TypedDict):
    asked: float
    coverage: float
    groups: Count
    frames: Count
    trainings: Count
    as_they_are: _Counted
    drifted: NotRequired[_Counted]


class _Accuracy(TypedDict):
    frames: int
    float: dict[str, float]
    integer: dict[str, float]
    growth_percent: dict[str, float]
    saturated_values: dict[str, int]
    force_interval: NotRequired[_Intervals]


class _Latency(TypedDict, total=False):
    first_pixel_to_force: Count
    last_pixel_to_force: Count
    first_pixel_to_depth: Count
    first_pixel_to_normals: Count
    initiation_interval: Count


class _Simulated(TypedDict):
    latency_cycles: _Latency
    frames: int
    values_compared: int
    mismatches: int
    values_by_output: dict[str, int]
    markers_compared: int
    frame_indices: list[int]
    errors: object


class _Hardware(TypedDict):
    multipliers: dict[str, Count]
    latency_cycles_by_formula: dict[str, object]


KINDS = {
    "accuracy.json": TypeAdapter(_Accuracy),
    "sim.json": TypeAdapter(_Simulated),
    "verilog/hardware.json": TypeAdapter(_Hardware),
}


def read(folder: Path, name: str) -> dict:
    """The content of one of `KINDS` in a build folder, with all its keys.

    Raises DamagedFileError, one line with file and key, where something that the report needs is not there.
    """
    path = folder / name
    content = read_json(path)
    try:
        KINDS[name].validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise DamagedFileError(f"{path}: {key}: {first['msg']}") from None
    if name == "accuracy.json" and content["float"].keys() != content["integer"].keys():
        unlike = ", ".join(sorted(content["float"].keys() ^ content["integer"].keys()))
        raise DamagedFileError(f"{path}: float and integer: {unlike}: expected in both")
    return content
