"""Speed of the integers as ONNX under onnxruntime, beside the emulator that they equal on every value.

fastac bench onnx BUNDLE…
"""

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import onnxruntime

from fastac.export import onnx_check
from fastac.export.onnx_file import INPUT, model_of
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import load_bundle
from fastac.report.tables import text_table
from fastac.studies.benchmarks.models import benchmark_frames, cells, scene_outputs
from fastac.studies.benchmarks.timing import fastest

FRAMES, REPEATS = 16, 5


def measure(path: Path) -> Iterator[str]:
    """Time a bundle's ONNX and its emulator, and compare them; yields lines of text."""
    bundle = load_bundle(path)
    frames = benchmark_frames(bundle, path)[:FRAMES]
    emulator, session = Emulator(bundle.pipeline), onnx_check.session_of(model_of(bundle))
    found = onnx_check.compare(bundle, session, "integer", frames)
    if found.different:
        raise ValueError(f"{path}: {found.first}: {found.different} of {found.values} values differ")
    size = " × ".join(map(str, bundle.pipeline.background.shape))
    yield (
        f"{path}, {size}, onnxruntime {onnxruntime.__version__}, {os.cpu_count()} cores;"
        f" of {REPEATS} runs over {FRAMES} frames the fastest:"
    )
    wanted = scene_outputs(bundle.scene)["emulator"]
    runs = {
        "ONNX, a frame a call": lambda: [session.run(None, {INPUT: frame[None]}) for frame in frames],
        "ONNX, all frames in a call": partial(session.run, None, {INPUT: frames}),
        f"emulator, {', '.join(wanted)}, a frame a call": lambda: [
            emulator.run(frame[None], wanted=wanted) for frame in frames
        ],
        "emulator, all results, all frames in a call": partial(emulator.run, frames),
    }
    rows = [cells(name, fastest(run, REPEATS), len(frames)) for name, run in runs.items()]
    yield text_table(["model", "ms a frame", "frames/s", "processor ms a frame"], rows)
    yield f"ONNX = emulator: {found.values:,} of {found.values:,} values, all outputs of {FRAMES} frames"
