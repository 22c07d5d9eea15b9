"""Frames that no camera sends, and boundary priors as deep as the words hold: is every value finite, does the
emulator equal the int64 loop, and are the frames flagged?"""

import numpy as np

from fastac.flow import verify
from fastac.models.emulator import direct
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.assemble import assemble
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.frame_validity import REASONS
from fastac.models.integer.pipeline import IntegerPipeline

PRIOR_STEPS = 7
"""Bisections in the search for the deepest boundary prior."""


def count_mismatches(pipeline: IntegerPipeline, frames: np.ndarray) -> int:
    """Number of values, over all outputs, in which the emulator differs from the int64 loop."""
    outputs = direct.outputs(pipeline)
    loop = {name: np.empty((len(frames), *shape), kind) for name, (shape, kind) in outputs.items()}
    direct.loop(pipeline, frames, loop)
    found = Emulator(pipeline).run(frames)
    return sum(int((getattr(found, name) != values).sum()) for name, values in loop.items())


def images(bundle: Bundle) -> list[dict]:
    """One row per special frame of `verify.SPECIAL`: flags, saturations, whether every value is finite."""
    pipeline, frames = bundle.pipeline, verify.special_frames(bundle.pipeline.background)
    results = [Emulator(pipeline).run(frames), FloatPipeline.from_bundle(bundle).run(frames)]
    rows = []
    for k, name in enumerate(verify.SPECIAL):
        fields = [value[k] for result in results for value in vars(result).values() if value is not None]
        row = {
            "frame": name,
            "reasons": [reason for bit, reason in enumerate(REASONS) if results[0].validity[k] >> bit & 1],
            "finite": all(bool(np.isfinite(value).all()) for value in fields),
            "emulator_vs_loop_mismatches": count_mismatches(pipeline, frames[k : k + 1]),
            "pixels_with_n_z_not_positive": int((results[0].normal_words[k, ..., 2] <= 0).sum()),
        }
        for kind in ("gradient_saturated", "displacement_saturated"):
            if getattr(results[0], kind) is not None:
                row[kind] = int(getattr(results[0], kind)[k])
        rows.append(row)
    return rows


def deepest_prior(bundle: Bundle) -> dict | None:
    """The largest boundary prior that the scene's words hold in absolute mode, and mismatches there.

    None without a Poisson solver, and where not even the scene's own prior fits.
    """
    known = bundle.pipeline
    if known.solver is None:
        return None
    poisson = known.scene.poisson.model_copy(update={"mode": "absolute"})
    scene = known.scene.model_copy(update={"poisson": poisson})
    shape = known.rest_depth_mm if known.rest_depth_mm.any() else np.ones_like(known.rest_depth_mm)

    def at(factor: float) -> IntegerPipeline | None:
        try:
            return assemble(
                scene, layers=known.layers, background=known.background, rest_depth_mm=factor * shape
            )
        except ValueError:
            return None

    low, high = 1.0, 2.0
    if at(low) is None:
        return None
    while at(high) is not None:
        low, high = high, 4 * high
    for _ in range(PRIOR_STEPS):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if at(middle) is None else (middle, high)
    frames = np.concatenate([known.background[None], verify.special_frames(known.background)])
    pipeline = at(low)
    return {
        "largest_mm": float(np.abs(low * shape).max()),
        "refused_mm": float(np.abs(high * shape).max()),
        "source_bits": pipeline.source.width,
        "depth_bits": pipeline.depth.width,
        "frames": len(frames),
        "emulator_vs_loop_mismatches": count_mismatches(pipeline, frames),
    }
