"""The integer pipeline in int64 and nothing else, frame by frame: slow, and right for tables of any size.

The emulator must equal it on every value, and gives way to it where float64 would not be exact.
"""

import numpy as np

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.dot_spread import spread_px
from fastac.models.integer.features import integer_features
from fastac.models.integer.force import PatchForce, terms
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.words import round_shift
from fastac.models.loops.frames import Outputs


def _in_int64(stage, words: np.ndarray) -> np.ndarray:
    """A stage's output without float64, which a sine transform's own product passes through."""
    if isinstance(stage, SineTransform):
        return round_shift(words @ stage.matrix, stage.shift, stage.rounding)
    return stage(words)


def solve(solver: IntegerSolver, source: np.ndarray) -> np.ndarray:
    """A source (N, N) to the solution (N, N), as the solver defines it."""
    *_, (_, _, solution) = solver.steps(source, _in_int64)
    return solution


def find(pipeline: IntegerPipeline, frame: np.ndarray) -> dict[str, np.ndarray]:
    """Everything that the scene wants of a frame (H, W, C) uint8, by name, as in `pipeline.Result`."""
    smoothing_px = pipeline.scene.network.smoothing_px
    x = integer_features(frame, pipeline.background, smoothing_px).astype(np.int64)
    for layer in pipeline.layers:
        x = x @ layer.weight.T.astype(np.int64) + layer.bias
        if layer.requantisation is not None:
            x = layer.requantisation(x)
    slopes, saturated = pipeline.slopes(x, frame)
    length = np.linalg.norm(x.astype(np.float64), axis=-1, keepdims=True)
    found = {
        "normals": x / np.maximum(length, 1),
        "slopes": slopes * 2.0**-pipeline.ratio.fraction,
        "normal_words": x,
        "gradient_saturated": saturated.sum(),
    }
    measures = [*pipeline.validity.of_pixels(frame, pipeline.background)]
    if pipeline.validity.slopes:
        measures.append(saturated.sum())
    force_input = slopes  # unless the force is of the displacement
    if pipeline.solver is not None:
        depth, displacement = pipeline.depth(solve(pipeline.solver, pipeline.source(slopes)))
        depth_mm = pipeline.rest_depth_mm.copy()
        depth_mm[1:-1, 1:-1] = depth * pipeline.depth_mm_per_unit
        displacement_mm = displacement * pipeline.depth_mm_per_unit
        found |= {"depth_words": depth, "depth_mm": depth_mm, "displacement_mm": displacement_mm}
    if pipeline.quantiser is not None:
        words, over = pipeline.quantiser(displacement)
        found |= {"displacement_words": words, "displacement_saturated": over.sum()}
        measures.append(over.sum())
        force_input = terms(words, pipeline.bends)
    if pipeline.follower is not None:
        shifts, seen = pipeline.follower(pipeline.follower.windows(frame))
        found |= {"dot_shift_words": shifts, "dot_shifts_px": shifts * 2.0**-FRACTION, "dots_seen": seen}
        measures.append((~seen).sum())
    measures = np.array(measures)
    found |= {"validity_measures": measures, "validity": pipeline.validity.flags(measures)}
    if pipeline.force is not None:
        if isinstance(pipeline.force, PatchForce):
            raw = pipeline.force(words)
        else:
            raw = (pipeline.force.weight * force_input).sum(axis=(1, 2, 3)) + pipeline.force.constant
        if pipeline.dot_force is not None:
            dots = pipeline.dot_force
            raw = raw + ((dots.weighted.weight[:, :, 0] * shifts).sum(axis=(1, 2)) << dots.exponent)
        found |= {"force_raw": raw, "force_n": raw * pipeline.force_n_per_unit}
        if pipeline.interval is not None:
            found |= interval_of(pipeline, measures, raw)
        if pipeline.spread is not None:
            spread, dots = pipeline.spread(shifts, seen, words)
            found |= slip_of(pipeline, spread, dots)
        if pipeline.scene.wants_force_map:
            raw = pipeline.force.force_map(words)
            found |= {"force_map_raw": raw, "force_map_n": raw * pipeline.force_n_per_unit[:, None, None]}
    return found


def slip_of(pipeline: IntegerPipeline, spread: np.ndarray, dots: np.ndarray) -> dict[str, np.ndarray]:
    """Spreads and numbers of dots in contact to the outputs that tell of slip."""
    slipping = spread > pipeline.slip_limit
    return {"slip_words": spread, "slip_px": spread_px(spread), "slip_dots": dots, "slipping": slipping}


def interval_of(
    pipeline: IntegerPipeline, measures: np.ndarray, force_raw: np.ndarray
) -> dict[str, np.ndarray]:
    """All of FrameValidity's measures (…, measures) and raw forces (…, axes) to the interval's outputs."""
    interval = pipeline.interval
    half = interval.half_widths(measures[..., interval.columns(pipeline.validity.names)], force_raw)
    return {"force_half_width_raw": half, "force_half_width_n": half * pipeline.force_n_per_unit}


def outputs(pipeline: IntegerPipeline) -> Outputs:
    """Shapes for one frame and element types of everything that the scene wants; see `pipeline.Result`."""
    height, width, _ = pipeline.background.shape
    inner = (height - 2, width - 2)
    found: Outputs = {
        "normals": ((height, width, 3), np.float32),
        "slopes": ((height, width, 2), np.float32),
        "normal_words": ((height, width, 3), np.int32),
        "gradient_saturated": ((), np.int64),
        "validity_measures": ((len(pipeline.validity.names),), np.int64),
        "validity": ((), np.int64),
    }
    if pipeline.solver is not None:
        found |= {
            "depth_words": (inner, np.int64),
            "depth_mm": ((height, width), np.float32),
            "displacement_mm": (inner, np.float32),
        }
    if pipeline.quantiser is not None:
        found |= {"displacement_words": (inner, np.int64), "displacement_saturated": ((), np.int64)}
    if pipeline.follower is not None:
        count = len(pipeline.follower.rest)
        found |= {
            "dot_shift_words": ((count, 2), np.int64),
            "dot_shifts_px": ((count, 2), np.float32),
            "dots_seen": ((count,), np.bool_),
        }
    if pipeline.force is not None:
        axes = len(pipeline.force_n_per_unit)
        found |= {"force_raw": ((axes,), np.int64), "force_n": ((axes,), np.float64)}
        if pipeline.interval is not None:
            found |= {
                "force_half_width_raw": ((axes,), np.int64),
                "force_half_width_n": ((axes,), np.float64),
            }
        if pipeline.spread is not None:
            found |= {"slip_words": ((), np.int64), "slip_px": ((), np.float64)}
            found |= {"slip_dots": ((), np.int64), "slipping": ((), np.bool_)}
        if pipeline.scene.wants_force_map:
            maps = (axes, *inner)
            found |= {"force_map_raw": (maps, np.int64), "force_map_n": (maps, np.float32)}
    return found


def loop(pipeline: IntegerPipeline, frames: np.ndarray, out: dict[str, np.ndarray]) -> None:
    """Fill the places `out` (frames, …) of the outputs of frames (frames, H, W, C) uint8."""
    for k, frame in enumerate(frames):
        found = find(pipeline, frame)
        for name, place in out.items():
            place[k] = found[name]
