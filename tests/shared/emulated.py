"""A pipeline's words on frames in three ways: by its stages' own functions, the int64 loop, the emulator."""

import numpy as np

from fastac.models import random_bundle
from fastac.models.emulator import direct
from fastac.models.emulator.exact import ExactTables
from fastac.models.emulator.worker import Worker
from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.force import PatchForce, terms
from fastac.models.loops.frames import over_frames


def frames_of(background: np.ndarray) -> np.ndarray:
    """The background, random changes of every strength, and extremes; more than one chunk."""
    black, white, bright = np.zeros_like(background), np.full_like(background, 255), background.copy()
    bright[tuple(n // 2 for n in bright.shape[:2])] = 255
    v, u = np.indices(background.shape[:2])
    checkerboard = np.where(((u + v) % 2)[..., None], white, black)
    extremes = [background, black, white, checkerboard, bright]
    return np.concatenate([extremes, random_bundle.frames(background, (3, 12, 40, 255) * 4)])


def defined(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    """The words of frames by the stages' own functions."""
    normals = pipeline.normals(frames)
    slopes, saturated = pipeline.ratio(normals)
    if pipeline.bridge is not None:
        dark = pipeline.bridge.dark(frames)
        slopes, saturated = pipeline.bridge(slopes, dark), pipeline.bridge(saturated, dark)
    found = {
        "normal_words": normals,
        "slopes": (slopes * 2.0**-pipeline.ratio.fraction).astype(np.float32),
        "gradient_saturated": saturated.sum(axis=(1, 2, 3)),
    }
    if pipeline.solver is not None:
        found["depth_words"], displacement = pipeline.depth(pipeline.solver(pipeline.source(slopes)))
    if pipeline.quantiser is not None:
        words, over = pipeline.quantiser(displacement)
        found |= {"displacement_words": words, "displacement_saturated": over.sum(axis=(1, 2))}
    if isinstance(pipeline.force, PatchForce):
        found["force_raw"] = pipeline.force(words)
        if pipeline.scene.wants_force_map:
            found["force_map_raw"] = pipeline.force.force_map(words)
    elif pipeline.force is not None:
        found["force_raw"] = pipeline.force(
            slopes if pipeline.quantiser is None else terms(words, pipeline.bends)
        )
    if pipeline.follower is not None:
        shift, seen = pipeline.follower(pipeline.follower.windows(frames))
        found |= {"dot_shift_words": shift, "dots_seen": seen}
        found["force_raw"] = found["force_raw"] + pipeline.dot_force(shift)
    if pipeline.spread is not None:
        found["slip_words"], found["slip_dots"] = pipeline.spread(shift, seen, words)
        found["slip_px"] = np.sqrt(found["slip_words"]) * 2.0**-FRACTION
        found["slipping"] = found["slip_px"] > np.sqrt(pipeline.slip_limit) * 2.0**-FRACTION
    columns = [np.array([pipeline.validity.of_pixels(frame, pipeline.background) for frame in frames])]
    for name in ("gradient", "displacement"):
        if name in pipeline.validity.names:
            columns.append(found[f"{name}_saturated"][:, None])
    if pipeline.follower is not None:
        columns.append((~seen).sum(axis=1, keepdims=True))
    measures = np.hstack(columns)
    return found | {"validity_measures": measures, "validity": pipeline.validity.flags(measures)}


def int64_loop(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    places = {
        name: np.empty((len(frames), *shape), kind)
        for name, (shape, kind) in direct.outputs(pipeline).items()
    }
    direct.loop(pipeline, frames, places)
    return places


def emulated(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    """By the emulator itself, which must not give way to the loop."""
    tables, outputs = ExactTables(pipeline), direct.outputs(pipeline)
    return over_frames(
        lambda: Worker(tables, frozenset(outputs)), frames, outputs, progress=False, label="test"
    )


def check(pipeline, frames: np.ndarray) -> dict[str, np.ndarray]:
    found, loop = emulated(pipeline, frames), int64_loop(pipeline, frames)
    assert found.keys() == loop.keys()
    for name, array in loop.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)
        assert found[name].tobytes() == array.tobytes(), name
    for name, array in defined(pipeline, frames).items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)
    return found
