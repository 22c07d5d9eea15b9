"""The files of a build that its report is made of, checked as they are read."""

from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from fastac.store.files import DamagedFileError, read_json


class _Accuracy(TypedDict):
    frames: int
    float: dict[str, float]
    integer: dict[str, float]
    growth_percent: dict[str, float]
    saturated_values: dict[str, int]


class _Simulated(TypedDict):
    latency_cycles: dict[str, int | dict[str, int]]
    frames: int
    values_compared: int
    mismatches: int
    values_by_output: dict[str, int]
    markers_compared: int
    frame_indices: list[int]
    errors: object


class _Hardware(TypedDict):
    multipliers: dict[str, int]
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
    return content
