"""Other scenes on the same sensor: a bundle's pixel network under another solver or another force."""

from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import assemble
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.loops.frames import CHUNK
from fastac.scenes.outputs import OUTPUTS
from fastac.scenes.schema import Scene, SceneError, describe
from fastac.scenes.solvers import SOLVERS
from fastac.store.progress import progress_bar


def variant(scene: Scene, *, mode: str | None = None, solver: str, **force) -> Scene:
    """The scene with another solver: with depth unless it is the adjoint, whose force does not clamp.

    Raises SceneError where that is impossible.
    """
    content = scene.model_dump(mode="json")
    forces = [name for name in content["outputs"] if OUTPUTS[name].force_axes]
    finds_depth = SOLVERS[solver].finds_depth
    content["outputs"] = ["depth", *forces] if finds_depth else forces
    content["poisson"] |= {"solver": solver, "mode": mode or scene.poisson.mode}
    content["force"] |= ({"fit": "displacement"} if finds_depth else {"clamp": False}) | force
    content["hardware"]["pixels_per_clock"] = 1
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        raise SceneError(f"scene {scene.name}: {describe(error)}") from None


def integer_variant(bundle: Bundle, scene: Scene) -> IntegerPipeline:
    """The bundle's pixel network under another scene, up to the displacement."""
    known = bundle.pipeline
    return assemble.assemble(
        scene, layers=known.layers, background=known.background, rest_depth_mm=known.rest_depth_mm
    )


def float_variant(bundle: Bundle, scene: Scene, weights: np.ndarray | None = None) -> FloatPipeline:
    return replace(FloatPipeline.from_bundle(bundle), scene=scene, force_weights=weights)


def slope_words(pipeline: IntegerPipeline, frames: np.ndarray, *, progress: bool) -> np.ndarray:
    """Frames to the integer slopes (frames, H, W, 2)."""
    starts = progress_bar(range(0, len(frames), CHUNK), desc="slopes", enabled=progress)
    return np.concatenate(
        [pipeline.slopes(pipeline.normals(frames[start : start + CHUNK]))[0] for start in starts]
    )
