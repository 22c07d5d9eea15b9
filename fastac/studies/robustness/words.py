# amaranth: UnusedElaboratable=no
"""The table of every word at its worst case, in the integers and in the hardware of its stage."""

import json
from pathlib import Path

from fastac.models.integer.pipeline import IntegerPipeline
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.store.sources import digest_sources
from fastac.studies.robustness.worst_case import WorstCase, of_pixels
from fastac.studies.robustness.worst_case_hardware import compare
from fastac.studies.robustness.worst_case_solver import of_solver

RTL_SOURCES = ("gateware/**/*.py", "models/**/*.py", "sim/**/*.py")


class ExtremesError(RuntimeError):
    """Hardware that is not what the integers say; the message is one line."""


def worst_cases(pipeline: IntegerPipeline) -> list[WorstCase]:
    return of_pixels(pipeline) + (of_solver(pipeline) if pipeline.solver is not None else [])


def rows(
    cases: list[WorstCase], digest: str, lanes: int, folder: Path, *, rtl: bool, progress: bool
) -> list[dict]:
    """The table of the words; with `rtl` each stage's hardware too, once for each bundle and sources."""
    file, key = folder / "rtl.json", [digest, digest_sources(RTL_SOURCES)]
    try:
        known = json.loads(file.read_text())
        compared = known["beats"] if known["key"] == key else {}
    except (OSError, ValueError, KeyError, TypeError):
        compared = {}
    found = []
    for case in progress_bar(cases, desc="stages", enabled=progress, leave=True):
        row = {
            "stage": case.name,
            "word": case.word,
            "width_bits": case.width,
            "bound": case.bound,
            "range_bound": case.range_bound,
            "reached": case.reached,
            "percent_of_range_bound": case.percent,
            "percent_of_bound": case.bound_percent,
            "head_room_bits": case.head_room_bits,
            "note": case.note,
        }
        name = f"{case.name}, {case.word}"
        if rtl and name not in compared:
            place = folder / "rtl" / case.word.split(",")[0].replace(" ", "_")
            try:
                compared[name] = compare(case, place, lanes=lanes)
            except (SystemExit, RuntimeError):
                raise ExtremesError(f"{place}: {name}: the hardware differs from the integers") from None
            write_json(file, {"key": key, "beats": compared})
        if name in compared:
            row |= {"rtl_beats": compared[name], "rtl_mismatches": 0}
        found.append(row)
    return found
