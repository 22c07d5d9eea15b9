# amaranth: UnusedElaboratable=no
"""The table of every word at its worst case, in the integers and in the hardware of its stage."""

from functools import lru_cache
from pathlib import Path

from fastac.models.integer import bundle as bundles
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.store.progress import progress_bar
from fastac.store.steps import Step
from fastac.store.store import open_store
from fastac.studies.robustness.worst_case import WorstCase, of_pixels
from fastac.studies.robustness.worst_case_dots import of_dots
from fastac.studies.robustness.worst_case_hardware import compare
from fastac.studies.robustness.worst_case_solver import of_solver


class ExtremesError(RuntimeError):
    """Hardware that is not what the integers say; the message is one line."""


def worst_cases(pipeline: IntegerPipeline) -> list[WorstCase]:
    """Of every stage that the pipeline has."""
    solver = of_solver(pipeline) if pipeline.solver is not None else []
    return of_pixels(pipeline) + solver + of_dots(pipeline)


@lru_cache(1)
def _cases(folder: Path, digest: str) -> dict[str, WorstCase]:
    """By name, those of the bundle in a folder; the digest is that of its content now."""
    return {title(case): case for case in worst_cases(bundles.load(folder).pipeline)}


def title(case: WorstCase) -> str:
    return f"{case.name}, {case.word}"


def compare_hardware(folder: Path, bundle: Path, case: str, *, logs: Path) -> int:
    """A step: beats of one case through its stage's hardware, all equal; the bench's output is in `logs`."""
    model = bundles.load(bundle)
    found = _cases(bundle, model.digest)[case]
    return compare(found, logs, lanes=model.scene.lanes)


def rows(bundle: Path, folder: Path, *, store: Path, rtl: bool, progress: bool) -> list[dict]:
    """The words of the bundle in the folder `bundle`; with `rtl` each stage's hardware too, once.

    folder : for what the benches print. Raises ExtremesError where the hardware differs.
    """
    cases = _cases(bundle, bundles.load(bundle).digest)
    found = []
    for name, case in progress_bar(cases.items(), desc="stages", enabled=progress, leave=True):
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
        if rtl:
            logs = folder / "rtl" / case.word.split(",")[0].replace(" ", "_")
            known = {"bundle": bundle, "case": name}
            step = Step("worst-case", compare_hardware, known, unkeyed={"logs": logs})
            try:
                row |= {"rtl_beats": open_store(store).value(step), "rtl_mismatches": 0}
            except (SystemExit, RuntimeError):
                raise ExtremesError(f"{logs}: {name}: the hardware differs from the integers") from None
        found.append(row)
    return found
