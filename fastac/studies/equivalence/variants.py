"""Variants of a bundle on the same sensor: its pixel network with another solver or another force model."""

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
    """The scene with another solver, at one pixel per clock.

    The outputs are depth and the scene's forces, or the forces alone for the adjoint, which has no clamp. No
    dots are followed.
    mode : of the Poisson solver, None: the scene's; force : other keys of the scene's `force` table
    Raises SceneError where the variant is impossible.
    """
    content = scene.model_dump(mode="json")
    forces = [name for name in content["outputs"] if OUTPUTS[name].force_axes]
    finds_depth = SOLVERS[solver].finds_depth
    content["outputs"] = ["depth", *forces] if finds_depth else forces
    content["poisson"] |= {"solver": solver, "mode": mode or scene.poisson.mode}
    content["force"] |= {"source": None, "dots": False, "band_mm": None, "deep_mm": None, "block_px": 1}
    of_slopes = not finds_depth and scene.fit_facts.of_slopes
    content["force"] |= {} if of_slopes else {"fit": "displacement"}
    content["force"] |= ({} if finds_depth else {"clamp": False}) | force
    content["training"]["force_weight"] = 0.0  # the network is trained already
    content["hardware"]["pixels_per_clock"] = 1
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        raise SceneError(f"scene {scene.name}: {describe(error)}") from None


def integer_variant(bundle: Bundle, scene: Scene) -> IntegerPipeline:
    """The bundle's integer pixel network with the rest of the pipeline of `scene`, without a force model."""
    known = bundle.pipeline
    return assemble.assemble(
        scene,
        layers=known.layers,
        background=known.background,
        rest_depth_mm=known.rest_depth_mm,
        bridge=known.bridge,
    )


def float_variant(bundle: Bundle, scene: Scene, weights: np.ndarray | None = None) -> FloatPipeline:
    """The bundle's float pipeline with another scene and other force weights."""
    return replace(FloatPipeline.from_bundle(bundle), scene=scene, force_weights=weights)


def slope_words(pipeline: IntegerPipeline, frames: np.ndarray, *, progress: bool) -> np.ndarray:
    """Frames (frames, H, W, C) uint8 to the pipeline's integer slopes (frames, H, W, 2)."""
    starts = progress_bar(range(0, len(frames), CHUNK), desc="slopes", enabled=progress)
    return np.concatenate([pipeline.slopes_of(frames[start : start + CHUNK])[0] for start in starts])
