"""A bundle at its extremes: every word at its worst case, frames that no camera sends, drift and faults.

    fastac study extremes BUILD_FOLDER

writes extremes.json and extremes.png there and prints the tables; `make extremes` builds a bundle first.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle, bundle_folder, load_bundle
from fastac.models.integer.frame_validity import REASONS
from fastac.report.tables import text_table
from fastac.sensor import samples
from fastac.sensor.dataset import Dataset, read
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.studies.robustness import drift, frames, words

FILE, PLOT = "extremes.json", "extremes.png"
DRIFT_FRAMES = 48
"""Held-out frames that drift and faults are applied to."""


def table(rows: list[dict], *columns: str) -> str:
    """The columns of rows for a terminal; what a row lacks stays empty."""

    def cell(value) -> str:
        if isinstance(value, float):
            return f"{value:.4g}"
        if isinstance(value, list | tuple | dict):
            return " ".join(value)
        return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)

    return text_table(
        [column.replace("_", " ") for column in columns],
        [[cell(row.get(column, "")) for column in columns] for row in rows],
    )


def false_alarms(bundle: Bundle, data: Dataset, *, progress: bool) -> dict:
    """By split, how many of the dataset's frames are flagged, and why, although all of them are good."""
    found = {}
    pipeline = accuracy.with_background_of(bundle.pipeline, data)
    for split in ("train", "validation", "test"):
        if len(index := data.indices(split)):
            flags = pipeline.run(data.frames[index], wanted=["validity"], progress=progress).validity
            found[split] = {
                "frames": len(index),
                "flagged": int((flags != 0).sum()),
                "reasons": [name for k, name in enumerate(REASONS) if (flags >> k & 1).any()],
            }
    return found


def measure(folder: Path, *, store: Path, rtl: bool, progress: bool) -> Iterator[str]:
    """Run all experiments; yields lines of text. extremes.json is written after each, so an interrupted run
    leaves the completed ones.

    store : folder of the step store, which keeps hardware comparisons and presses
    """
    bundle, file = load_bundle(folder), folder / FILE
    data = read(folder / "data.h5", bundle.scene)
    place = folder / "extremes"
    place.mkdir(exist_ok=True)
    content = {"scene": bundle.scene.name, "bundle_sha256": bundle.digest, "source": data.source}

    content["words"] = words.rows(bundle_folder(folder), place, store=store, rtl=rtl, progress=progress)
    write_json(file, content)
    yield "Every word at its worst case; the range is what the stage's own inputs allow for"
    columns = ("stage", "word", "width_bits", "bound", "range_bound", "reached", "percent_of_range_bound")
    yield table(content["words"], *columns, "percent_of_bound", "head_room_bits", "rtl_beats", "note")

    content["special_frames"] = frames.images(bundle)
    content["boundary_prior"] = frames.deepest_prior(bundle)
    write_json(file, content)
    yield "\nFrames that no camera sends"
    yield table(content["special_frames"], *content["special_frames"][0])
    if content["boundary_prior"]:
        yield "\nThe deepest boundary prior that absolute mode holds"
        yield table([content["boundary_prior"]], *content["boundary_prior"])

    content["good_frames"] = false_alarms(bundle, data, progress=progress)
    yield "\nFrames of the dataset, all good, that are flagged"
    rows = [{"split": split, **row} for split, row in content["good_frames"].items()]
    yield table(rows, "split", "frames", "flagged", "reasons")

    index = samples.evenly_spaced(data.indices("test"), DRIFT_FRAMES)
    content["drift_frame_indices"] = index.tolist()
    bar = partial(progress_bar, desc="faults", enabled=progress, leave=True)
    content["drift"] = list(drift.measure(bundle, data, index, store, progress=bar))
    write_json(file, content)
    drift.figure(content["drift"], folder / PLOT)
    yield "\nDrift and faults, on held-out frames"
    rows = [
        row
        | {"flagged_percent": 100 * row["suspect_share"]}
        | {f"{model}_{key}": value for model in ("float", "integer") for key, value in row[model].items()}
        for row in content["drift"]
    ]
    errors = [f"{model}_{key}" for key in drift.ERRORS for model in ("float", "integer")]
    errors = [key for key in errors if any(key in row for row in rows)]
    yield table(rows, "fault", "level", "unit", "frames", *errors, "flagged_percent", "reasons")
    finite = all(row[model]["finite"] for row in content["drift"] for model in ("float", "integer"))
    yield f"\nevery value of every frame is finite: {'yes' if finite else 'NO'}"
