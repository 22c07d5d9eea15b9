"""Ways to fit the force model to what a pipeline finds, by the names of `force.fit`.

Each entry has

    force_input(pipeline, frames, background)   what the model takes, by frames
    start(scene, samples)                       a trained model, or None, and its learning curve
    fit(scene, start, samples)                  from that model to the weights that integer/assemble.py takes,
                                                those of the dots, None without, and how they were chosen
"""

from dataclasses import dataclass

import numpy as np
import torch

from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.adjoint import displacement_mm, slope_weights
from fastac.models.floating.hyperforce import HyperForce, collapse, coordinates
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.force import block_means, terms
from fastac.models.training.force import hyperforce, polynomial_weights, press_symmetry, smooth_weights
from fastac.scenes.schema import Scene
from fastac.sensor.samples import FORCE_AXES
from fastac.store.kinds import Kinds

BySplit = dict[str, np.ndarray]
Curve = list[dict]


@dataclass(frozen=True, eq=False)
class ForceSamples:
    """What a force model is fitted to; by split name, but for the skin at rest."""

    found: BySplit
    """Its inputs, as the pipeline finds them."""
    force_n: BySplit
    """True forces (frames, axes)."""
    rest_depth_mm: np.ndarray
    """Of the skin at rest, (H, W)."""
    shifts_px: BySplit | None = None
    """The marker dots' shifts (frames, M, 2), if any are followed."""
    recording: BySplit | None = None
    """Integers, the same for frames of one recording, or of a part of the only one
    (`sensor.groups.left_out_together`)."""
    together: BySplit | None = None
    """Integers, the same for frames of one recording or press (`sensor.groups.groups`), if known."""


def slope_changes(
    pipeline: FloatPipeline | Emulator, frames: np.ndarray, background: np.ndarray, *, progress: bool
) -> np.ndarray:
    """Slopes less those at rest, (frames, H, W, 2)."""
    slopes = pipeline.run(frames, wanted=["slopes"], progress=progress).slopes
    return slopes - pipeline.run(background[None], wanted=["slopes"]).slopes


def found_displacement_mm(
    pipeline: FloatPipeline | Emulator, frames: np.ndarray, background: np.ndarray, *, progress: bool
) -> np.ndarray:
    """The displacement (frames, N, N) in mm; without a solver that of the slopes."""
    scene = pipeline.scene
    if not scene.force_from_slopes:
        return pipeline.run(frames, wanted=["displacement_mm"], progress=progress).displacement_mm
    change = slope_changes(pipeline, frames, background, progress=progress)
    return displacement_mm(change.astype(np.float64), scene.poisson.divergence, scene.sensor.pitch_mm)


def displacement_terms(
    pipeline: FloatPipeline | Emulator, frames: np.ndarray, background: np.ndarray, *, progress: bool
) -> np.ndarray:
    """What one weight a pixel each is multiplied with, (frames, N, N, terms) in mm; in squares that share
    their weights, the means."""
    force = pipeline.scene.force
    found = found_displacement_mm(pipeline, frames, background, progress=progress)
    return block_means(terms(found, force.bends_mm), force.block_px)


def changes_in_squares(
    pipeline: FloatPipeline | Emulator, frames: np.ndarray, background: np.ndarray, *, progress: bool
) -> np.ndarray:
    """`slope_changes`; in squares that share their weights, the means."""
    change = slope_changes(pipeline, frames, background, progress=progress)
    return block_means(change, pipeline.scene.force.block_px)


def force_weights(model: HyperForce, scene: Scene) -> np.ndarray:
    """A model's kernels (axes, N, N, K, K) or, for the adjoint, its weights of the slopes (axes, H, W, 2)."""
    with torch.inference_mode():
        kernels = model.kernels().numpy()
    if not scene.force_from_slopes:
        return kernels
    return slope_weights(collapse(kernels), scene.poisson.divergence, scene.sensor.pitch_mm)


def fits_validation(scene: Scene) -> bool:
    """Whether the last fit is to the validation split's presses too, after they have chosen its strength.

    Not where intervals are calibrated on them, nor where the network has learned from forces alone.
    """
    return not scene.wants_interval and scene.training.labels == "geometry"


def fits_robustly(scene: Scene) -> bool:
    """Whether a few wrong forces must not lead the last fit astray: those of a gauge, but not of a rig's."""
    return scene.training.labels == "force"


class DisplacementFit:
    """HyperForce on the displacement (N, N) in mm; the adjoint's weights of the slopes follow from it."""

    force_input = staticmethod(found_displacement_mm)

    @staticmethod
    def start(scene: Scene, samples: ForceSamples, *, progress: bool) -> tuple[HyperForce, Curve]:
        return hyperforce.train(
            scene, samples.rest_depth_mm, samples.found, samples.force_n, progress=progress
        )

    @staticmethod
    def fit(
        scene: Scene, start: HyperForce, samples: ForceSamples, *, progress: bool
    ) -> tuple[np.ndarray, np.ndarray | None, Curve]:
        model, of_dots, history = hyperforce.refit_last_layer(
            scene,
            start,
            samples.found,
            samples.force_n,
            samples.shifts_px,
            with_validation=fits_validation(scene),
            together=samples.together,
        )
        return force_weights(model, scene), of_dots, history


class WeightFit:
    """One weight a pixel and term of the displacement, (axes, N, N, terms), without a model to start from."""

    force_input = staticmethod(displacement_terms)

    @staticmethod
    def start(scene: Scene, samples: ForceSamples, *, progress: bool) -> tuple[None, Curve]:
        return None, []

    @staticmethod
    def fit(
        scene: Scene, start: None, samples: ForceSamples, *, progress: bool
    ) -> tuple[np.ndarray, np.ndarray | None, Curve]:
        return smooth_weights.fit(
            samples.found,
            samples.force_n,
            samples.shifts_px,
            with_validation=fits_validation(scene),
            recording=samples.recording if fits_robustly(scene) else None,
            together=samples.together,
            robust=fits_robustly(scene),
            patience=scene.training.patience_sizes,
            progress=progress,
        )


class PolynomialFit(WeightFit):
    """As `WeightFit`, but the weights are polynomials of the pixel's place on the skin at rest."""

    @staticmethod
    def fit(
        scene: Scene, start: None, samples: ForceSamples, *, progress: bool
    ) -> tuple[np.ndarray, np.ndarray | None, Curve]:
        return polynomial_weights.fit(
            coordinates(samples.rest_depth_mm[1:-1, 1:-1]),
            samples.found,
            samples.force_n,
            samples.shifts_px,
            with_validation=fits_validation(scene),
            together=samples.together,
        )


class SlopeFit(WeightFit):
    """Weights of the slopes (axes, H, W, 2), without a model to start from."""

    force_input = staticmethod(changes_in_squares)

    @staticmethod
    def fit(
        scene: Scene, start: None, samples: ForceSamples, *, progress: bool
    ) -> tuple[np.ndarray, np.ndarray | None, Curve]:
        if samples.shifts_px is not None or not scene.training.force_symmetry:
            return WeightFit.fit(scene, start, samples, progress=progress)
        weights, history = press_symmetry.fit(
            samples.found,
            samples.force_n,
            tuple(FORCE_AXES[k] for k in scene.force_axes),
            samples.recording,
            robust=fits_robustly(scene),
            patience=scene.training.patience_sizes,
            progress=progress,
        )
        return weights, None, history


FITS = Kinds(
    "force.fit",
    {
        "displacement": DisplacementFit,
        "weights": WeightFit,
        "polynomials": PolynomialFit,
        "slopes": SlopeFit,
    },
)
