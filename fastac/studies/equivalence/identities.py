"""The three identities of docs/mathematics.md on a trained bundle, and the fixed-point error in each.

    fastac study identities BUILD_FOLDER...

measures on 192 held-out frames of each build folder's data.h5, or on all where there are fewer; `make
identities` trains a bundle first.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.flow import training
from fastac.flow.frames import read
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.adjoint import slope_weights
from fastac.models.floating.hyperforce import collapse
from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer import assemble
from fastac.models.integer.bundle import Bundle, load_bundle
from fastac.models.integer.laplacian import boundary_term
from fastac.report.tables import text_table
from fastac.scenes import solvers as scene_solvers
from fastac.sensor.samples import evenly_spaced
from fastac.store.progress import progress_bar
from fastac.studies.equivalence import adjoint_fits
from fastac.studies.equivalence.variants import integer_variant, slope_words, variant

SOLVERS = ("dst2d", "tridiagonal")
FRAMES = 192
"""Held-out frames that are measured on, evenly spaced."""


@dataclass(frozen=True)
class SolverError:
    """Depth error of an integer solver against float64 on the same integer slopes.

    words : "name total_bits.fraction_bits" of each of the solver's stages
    """

    mode: str
    solver: str
    mean_um: float
    largest_um: float
    words: tuple[str, ...]


def rest_words(bundle: Bundle) -> np.ndarray:
    """The integer slopes of the background, (H, W, 2)."""
    return slope_words(bundle.pipeline, bundle.pipeline.background[None], progress=False)[0]


def constants(bundle: Bundle) -> dict[str, np.ndarray]:
    """By Poisson mode, the constant (N, N) subtracted from the divergence of the slopes: the boundary prior's
    term in absolute mode, the divergence at rest in difference mode."""
    scene, known = bundle.scene, bundle.pipeline
    rest = rest_words(bundle) * 2.0**-known.ratio.fraction
    return {
        "absolute": boundary_term(known.rest_depth_mm / scene.sensor.pitch_mm),
        "difference": source_of(rest, scene.poisson.divergence),
    }


def solver_errors(bundle: Bundle, words: np.ndarray, *, progress: bool) -> Iterator[SolverError]:
    """Errors of both integer solvers in both modes on integer slopes `words` (frames, H, W, 2)."""
    divergence, pitch_mm = bundle.scene.poisson.divergence, bundle.scene.sensor.pitch_mm
    unit = 2.0**-bundle.pipeline.ratio.fraction
    for mode, constant in constants(bundle).items():
        exact = [solve(source_of(frame * unit, divergence) - constant) for frame in words]
        for name in SOLVERS:
            pipeline = integer_variant(bundle, variant(bundle.scene, mode=mode, solver=name))
            format = pipeline.solver.depth_format
            bar = progress_bar(words, desc=f"{name}, {mode}", unit="frame", enabled=progress)
            error = np.abs(
                [
                    format.to_float(pipeline.solver(pipeline.source(frame))) - z
                    for frame, z in zip(bar, exact, strict=True)
                ]
            )
            stages = tuple(f"{s.name} {s.format.width}.{s.format.fraction}" for s in pipeline.solver.stages)
            um = 1e3 * pitch_mm
            yield SolverError(mode, name, um * float(error.mean()), um * float(error.max()), stages)


@dataclass(frozen=True)
class Mismatches:
    """Comparison of the accumulators of two force models on the same frames."""

    frames: int
    accumulators: int
    mismatches: int


def patch_mismatches(
    bundle: Bundle, weights: np.ndarray, frames: np.ndarray, *, progress: bool
) -> Mismatches:
    """Compare the accumulators of K×K kernels `weights` (axes, N, N, K, K) with one weight per pixel, on
    frames (frames, H, W, C)."""
    own = bundle.scene.poisson.solver
    solver = own if scene_solvers.SOLVERS[own].finds_depth else "tridiagonal"
    upto = integer_variant(bundle, variant(bundle.scene, solver=solver))
    words = Emulator(upto).run(frames, progress=progress).displacement_words
    patch, collapsed = (
        assemble.with_force(
            upto.replace(scene=variant(bundle.scene, solver=solver, kernel=kernel)), weights
        ).force
        for kernel in ("patch", "collapsed")
    )
    bar = progress_bar(words, desc="patches", unit="frame", enabled=progress)
    raw = np.array([patch(frame) for frame in bar])
    return Mismatches(len(frames), raw.size, int((raw != collapsed(words[..., None])).sum()))


def identity_errors(bundle: Bundle, kernels: np.ndarray, words: np.ndarray) -> dict[str, float]:
    """By Poisson mode, the largest difference between the adjoint's force and that of the depth path without
    clamp, relative to the largest force, in float64.

    kernels : (axes, N, N, K, K); words : integer slopes (frames, H, W, 2)
    """
    divergence, pitch_mm = bundle.scene.poisson.divergence, bundle.scene.sensor.pitch_mm
    unit, weight, errors = 2.0**-bundle.pipeline.ratio.fraction, collapse(kernels), {}
    rest = rest_words(bundle) * unit
    ab = slope_weights(weight, divergence, pitch_mm)
    constant = -np.einsum("ijt,aijt->a", rest, ab)
    for mode, known in constants(bundle).items():
        force, difference = 0.0, 0.0
        zero = solve(source_of(rest, divergence) - known)
        for slopes in words * unit:
            displacement_mm = pitch_mm * (zero - solve(source_of(slopes, divergence) - known))
            by_depth = np.einsum("ij,aij->a", displacement_mm, weight)
            by_slopes = constant + np.einsum("ijt,aijt->a", slopes, ab)
            force = max(force, np.abs(by_depth).max())
            difference = max(difference, np.abs(by_depth - by_slopes).max())
        errors[mode] = float(difference / force)
    return errors


def measure(folder: Path, *, progress: bool) -> Iterator[str]:
    """Measure all three identities on one build folder; yields lines of text."""
    bundle, file = load_bundle(folder), folder / "data.h5"
    scene = bundle.scene
    data = read(file, scene)
    training.require(data, scene, file)
    index = evenly_spaced(data.indices("test"), FRAMES)
    frames = data.frames[index]
    size = "×".join(str(side) for side in frames.shape[1:3])
    yield (
        f"{folder}: bundle {bundle.digest[:16]}, {len(frames)} held-out frames of {size} px,"
        f" {scene.poisson.divergence} divergence, {data.source}"
    )
    words = slope_words(bundle.pipeline, frames, progress=progress)

    yield "\n(a) integer solution from float64's, same integer slopes; words: total bits.fractional bits"
    yield text_table(
        ["mode", "solver", "mean, µm", "largest, µm", "words"],
        [
            [row.mode, row.solver, f"{row.mean_um:.4f}", f"{row.largest_um:.4f}", ", ".join(row.words)]
            for row in solver_errors(bundle, words, progress=progress)
        ],
    )
    if not scene.wants_force:
        return

    fits = adjoint_fits.fit(bundle, data, progress=progress)
    own = bundle.floats["force.integer_weights"].astype(np.float64)
    weights, whose = (own, "the bundle's") if own.ndim == 5 else (fits.kernels, "fitted without clamp")
    found = patch_mismatches(bundle, weights, frames, progress=progress)
    yield f"\n(b) K×K patches against one weight a pixel, K = {weights.shape[-1]}, kernels {whose}"
    yield f"{found.frames} frames, {found.accumulators} accumulators, {found.mismatches} mismatches"

    yield "\n(c) adjoint against the depth path without clamp, float64, largest relative difference of force"
    found = identity_errors(bundle, fits.kernels, words)
    yield text_table(["mode", "difference"], [[mode, f"{error:.1e}"] for mode, error in found.items()])

    bits, axes = scene.numbers.slope_weight_bits, ["xyz"[axis] for axis in scene.force_axes]
    rows = list(adjoint_fits.accuracies(bundle, data, index, fits, words, progress=progress))
    yield f"\ninteger adjoint ({bits}-bit weights) from its float weights, same integer slopes"
    errors = [(row.fit, row.rounding) for row in rows]
    yield text_table(
        ["fitted to", "mean, mN", "largest, mN", "bound, mN", "relative"],
        [
            [fit, f"{e.mean_mn:.4f}", f"{e.largest_mn:.4f}", f"{e.bound_mn:.3f}", f"{e.largest_relative:.1e}"]
            for fit, e in errors
        ],
    )
    yield "\nforce NMAE, %, on the slopes that were fitted (float, integer, true); what noise adds, mN"
    columns = [f"{name} {axis}" for name in (*rows[0].nmae_percent, "noise") for axis in axes]
    values = [
        (row.fit, [*(v for part in row.nmae_percent.values() for v in part), *row.noise_mn]) for row in rows
    ]
    yield text_table(["fitted to", *columns], [[fit, *(f"{v:.3f}" for v in own)] for fit, own in values])
