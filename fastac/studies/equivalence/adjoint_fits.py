"""Three ways to fit the adjoint solver's weights of the slopes, and their accuracy on held-out frames."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from fastac.flow.force_fits import fits_validation, force_weights, slope_changes
from fastac.flow.pipelines import rest_depth_mm
from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.adjoint import displacement_mm, slope_weights
from fastac.models.integer import assemble
from fastac.models.integer.bundle import Bundle
from fastac.models.training.force import hyperforce, smooth_weights
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.geometry import rest_slopes
from fastac.sensor.groups import groups
from fastac.studies.equivalence.variants import float_variant, integer_variant, slope_words, variant

FITS = ("displacement", "smooth", "slopes")
"""How the adjoint's weights are fitted: HyperForce on the displacement; one smooth weight per pixel of the
displacement (the same cosines and ridge regression as `slopes`); or weights of the slopes directly."""


@dataclass(frozen=True, eq=False)
class Fits:
    """Fitted weights of the force.

    kernels : (axes, N, N, K, K), HyperForce on the unclamped displacement from the integer model's slopes
    weights : of the slopes (axes, H, W, 2) in N, by the name in FITS and by whose slopes were fitted
        ("float", "integer" or "true")
    """

    kernels: np.ndarray
    weights: dict[tuple[str, str], np.ndarray]


def fit(bundle: Bundle, data: Dataset, *, progress: bool) -> Fits:
    """Fit the adjoint's weights in each way of FITS; the scene's `force.fit` as a training does."""
    scene = variant(bundle.scene, solver="adjoint", fit="slopes")
    divergence, pitch_mm = scene.poisson.divergence, scene.sensor.pitch_mm
    splits = {s: data.indices(s) for s in ("train", "validation") if len(data.indices(s))}
    truth = {split: data.forces_n(index, scene.force_axes) for split, index in splits.items()}
    found = {
        name: {
            split: slope_changes(pipeline, data.frames[index], data.background, progress=progress)
            for split, index in splits.items()
        }
        for name, pipeline in (
            ("float", float_variant(bundle, scene)),
            ("integer", Emulator(integer_variant(bundle, scene))),
        )
    }
    true = {split: true_change(scene, data, index) for split, index in splits.items()}
    if true["train"] is not None:
        found["true"] = true
    weights, models, start = {}, {}, None
    known = groups(data)
    together = {split: known[index] for split, index in splits.items()}
    last = {"with_validation": fits_validation(scene), "together": together}
    fit_smooth = partial(smooth_weights.fit, **last, progress=progress)
    for name, change in found.items():
        weights["slopes", name], *_ = fit_smooth(change, truth)
        pressed = {s: displacement_mm(x.astype(np.float64), divergence, pitch_mm) for s, x in change.items()}
        smooth, *_ = fit_smooth({s: x[..., None] for s, x in pressed.items()}, truth)
        weights["smooth", name] = slope_weights(smooth[..., 0], divergence, pitch_mm)
        if start is None:
            rest = rest_depth_mm(data)
            start, _ = hyperforce.train(scene, rest, pressed, truth, progress=progress)
        models[name], *_ = hyperforce.refit_last_layer(scene, start, pressed, truth, **last)
        weights["displacement", name] = force_weights(models[name], scene)
    with torch.inference_mode():
        kernels = models["integer"].kernels().double().numpy()
    return Fits(kernels, weights)


def true_change(scene: Scene, data: Dataset, index: np.ndarray) -> np.ndarray | None:
    """The true slopes less those at rest, (frames, H, W, 2); None unless simulated with all normals known."""
    if scene.sensor.source != "simulated" or data.normals is None or data.valid is not None:
        return None
    normals = data.normals[index].astype(np.float64)
    return -normals[..., :2] / normals[..., 2:] - np.stack(rest_slopes(scene.sensor), axis=-1)


def with_more_noise(frames: np.ndarray, scene: Scene) -> np.ndarray:
    """The frames with the camera's read and shot noise added a second time."""
    sensor, rng = scene.sensor, np.random.default_rng(scene.protocol.seed)
    again = np.empty_like(frames)
    for k, frame in enumerate(frames):
        deviation = np.sqrt(sensor.noise_dn**2 + frame / sensor.electrons_per_dn)
        again[k] = np.clip(np.rint(frame + deviation * rng.standard_normal(frame.shape)), 0, 255)
    return again


@dataclass(frozen=True)
class AdjointError:
    """Rounding error of the integer adjoint against its float weights on the same integer slopes.

    largest_relative : relative to the largest force of each axis
    bound_mn : what half a unit of error in every weight could add up to
    """

    mean_mn: float
    largest_mn: float
    largest_relative: float
    bound_mn: float


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of one way to fit the adjoint's weights.

    nmae_percent : by source of the slopes ("float", "integer", "true"), then by axis
    rounding : error of the integer weights
    noise_mn : by axis, standard deviation of the force that additional camera noise causes
    """

    fit: str
    nmae_percent: dict[str, list[float]]
    rounding: AdjointError
    noise_mn: list[float]


def accuracies(
    bundle: Bundle, data: Dataset, index: np.ndarray, fits: Fits, words: np.ndarray, *, progress: bool
) -> Iterator[Accuracy]:
    """Accuracy of every fit on the frames `index`; `words` (frames, H, W, 2) are their integer slopes."""
    scene = variant(bundle.scene, solver="adjoint")
    upto, frames = integer_variant(bundle, scene), data.frames[index]
    again, true = with_more_noise(frames, scene), true_change(scene, data, index)
    rest = slope_words(upto, bundle.pipeline.background[None], progress=False)[0]
    unit = 2.0**-upto.ratio.fraction
    for name in FITS:
        weights = {arithmetic: fits.weights[name, arithmetic] for arithmetic in ("float", "integer")}
        integer = Emulator(assemble.with_force(upto, weights["integer"]))
        found = {
            "float": float_variant(bundle, scene, weights["float"]).run(frames, progress=progress),
            "integer": integer.run(frames, progress=progress),
        }
        if true is not None:
            weight = fits.weights[name, "true"]
            found["true"] = replace(found["float"], force_n=np.einsum("nijt,aijt->na", true, weight))
        noise = integer.run(again, progress=progress).force_n - found["integer"].force_n
        nmae = {
            arithmetic: [
                accuracy.force(replace(result, force_n=result.force_n[:, [k]]), data, index, (axis,))[
                    "force_nmae_percent"
                ]
                for k, axis in enumerate(scene.force_axes)
            ]
            for arithmetic, result in found.items()
        }
        exact = np.array(
            [np.einsum("ijt,aijt->a", (frame - rest) * unit, weights["integer"]) for frame in words]
        )
        error = np.abs(found["integer"].force_n - exact)
        reach = max(int(np.abs(frame - rest).sum()) for frame in words)
        yield Accuracy(
            name,
            nmae,
            AdjointError(
                1e3 * float(error.mean()),
                1e3 * float(error.max()),
                float((error.max(axis=0) / np.abs(exact).max(axis=0)).max()),
                1e3 * float(0.5 * reach * integer.pipeline.force_n_per_unit.max()),
            ),
            (1e3 * noise.std(axis=0)).tolist(),
        )
