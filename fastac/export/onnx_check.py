"""An ONNX model in onnxruntime beside the pipelines that it must equal: the integers on every value."""

from dataclasses import dataclass

import numpy as np
import onnx
import onnxruntime

from fastac.export.onnx_file import BACKGROUND, FLOAT_PREFIX, INPUT, ExportError
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle

RANDOM = 4
"""Frames of noise, and as many of random changes of the background."""


@dataclass(frozen=True)
class Differences:
    """What a comparison found.

    values, different : of the integers, how many were compared and how many differ
    largest : by output of the float models, the largest absolute difference, in the output's unit
    """

    values: int
    different: int
    first: str
    """The first output of the integers that differs, or empty."""
    largest: dict[str, float]


def session_of(model: onnx.ModelProto, *, threads: int = 0) -> onnxruntime.InferenceSession:
    """A model in onnxruntime on the processor; 0 threads: as many as it chooses."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )


def run(session: onnxruntime.InferenceSession, frames: np.ndarray, background: np.ndarray) -> dict:
    """All outputs by name, for frames (frames, H, W, C) uint8."""
    given = {INPUT: frames, BACKGROUND: background}
    names = [value.name for value in session.get_inputs()]
    found = session.run(None, {name: given[name] for name in names})
    return dict(zip((value.name for value in session.get_outputs()), found, strict=True))


def extreme_frames(background: np.ndarray) -> np.ndarray:
    """The background, all 0, all 255, a checkerboard of both, noise, and random changes of all strengths."""
    rng = np.random.default_rng(1)
    checkerboard = np.broadcast_to(
        np.where(np.indices(background.shape[:2]).sum(axis=0) % 2, 255, 0)[..., None], background.shape
    )
    noise = rng.integers(0, 256, (RANDOM, *background.shape))
    spans = np.geomspace(4, 255, RANDOM).astype(int)
    changed = [background + rng.integers(-span, span + 1, background.shape) for span in spans]
    flat = [background, np.zeros_like(background), np.full_like(background, 255), checkerboard]
    return np.clip(np.concatenate([flat, noise, changed]), 0, 255).astype(np.uint8)


def compare(
    bundle: Bundle, session: onnxruntime.InferenceSession, arithmetic: str, frames: np.ndarray
) -> Differences:
    """Run frames (frames, H, W, C) uint8 through a bundle's ONNX model and its pipelines."""
    pipeline = bundle.pipeline
    found = run(session, frames, pipeline.background)
    prefix = {"integer": None, "float": "", "both": FLOAT_PREFIX}[arithmetic]
    of_floats = [n for n in found if prefix is not None and n.startswith(prefix)]
    values = different = 0
    first, largest = "", {}
    if arithmetic != "float":
        emulator = Emulator(pipeline).run(frames)
        for name in (n for n in found if n not in of_floats):
            known = _known(emulator, name, pipeline.ratio.fraction)
            values += known.size
            count = int((found[name] != known).sum()) if found[name].shape == known.shape else known.size
            different += count
            first = first or (name if count else "")
    if of_floats:
        from fastac.models.floating.pipeline import FloatPipeline

        floats = FloatPipeline.from_bundle(bundle).run(frames)
        for name in of_floats:
            known = getattr(floats, name.removeprefix(prefix)).astype(np.float64)
            largest[name] = float(np.abs(found[name] - known).max())
    return Differences(values, different, first, largest)


def checked(bundle: Bundle, model: onnx.ModelProto, arithmetic: str) -> list[str]:
    """What a comparison over `extreme_frames` found, as lines of text.

    Raises ExportError where a value of the integers differs.
    """
    frames = extreme_frames(bundle.pipeline.background)
    found = compare(bundle, session_of(model), arithmetic, frames)
    runtime = f"onnxruntime {onnxruntime.__version__}, {len(frames)} extreme and random frames"
    if found.different:
        count = f"{found.different} of {found.values} values"
        raise ExportError(f"{found.first}: {count} under {runtime} differ from the integers")
    lines = []
    if found.values:
        lines.append(f"integers under {runtime}: {found.values:,} of {found.values:,} values equal")
    if found.largest:
        most = ", ".join(f"{name} {value:.3g}" for name, value in found.largest.items())
        lines.append(f"float models under {runtime}, largest difference from ours: {most}")
    return lines


def _known(emulator, name: str, fraction: int) -> np.ndarray:
    if name == "slope_words":
        return emulator.slopes.astype(np.float64) * 2.0**fraction
    return getattr(emulator, name)
