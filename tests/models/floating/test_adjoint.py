"""The adjoint against the transposed dense operators, and against the force computed from the depth."""

import numpy as np
import pytest

from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.adjoint import displacement_mm, slope_weights, transposed_divergence
from fastac.models.floating.hyperforce import collapse
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer import assemble
from fastac.models.integer.laplacian import boundary_term

MODES = pytest.mark.parametrize("mode", ["absolute", "difference"])
DIVERGENCES = pytest.mark.parametrize("divergence", ["central", "backward"])


@DIVERGENCES
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_transposed_divergence_is_the_transpose(n, divergence):
    side = n + 2
    units = np.eye(2 * side**2).reshape(-1, side, side, 2)
    dense = source_of(units, divergence).reshape(len(units), -1).T  # (sources, slopes)
    fields = np.eye(n * n).reshape(-1, n, n)
    found = transposed_divergence(fields, divergence).reshape(len(fields), -1).T  # (slopes, sources)
    assert np.abs(dense).sum() > 0
    np.testing.assert_array_equal(found, dense.T)


@MODES
@DIVERGENCES
@pytest.mark.parametrize("n", [1, 2, 5, 14, 31])
def test_the_force_is_that_of_the_depth(n, divergence, mode):
    """F = constant + Σ (a·p + b·q), where prior and background contribute to the constant alone."""
    rng, pitch_mm = np.random.default_rng(n), 0.2
    weight = rng.normal(size=(3, n, n))
    rest, slopes = rng.normal(size=(n + 2, n + 2, 2)), rng.normal(size=(4, n + 2, n + 2, 2))
    prior = boundary_term(rng.normal(size=(n + 2, n + 2)))

    def depth_px(slopes: np.ndarray) -> np.ndarray:
        constant = prior if mode == "absolute" else source_of(rest, divergence)
        return solve(source_of(slopes, divergence) - constant)

    displacement = pitch_mm * (depth_px(rest) - depth_px(slopes))
    expected = np.einsum("nij,aij->na", displacement, weight)
    ab = slope_weights(weight, divergence, pitch_mm)
    assert ab.shape == (3, n + 2, n + 2, 2)
    constant = -np.einsum("ijt,aijt->a", rest, ab)
    found = constant + np.einsum("nijt,aijt->na", slopes, ab)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(
        displacement_mm(slopes - rest, divergence, pitch_mm),
        displacement,
        rtol=0,
        atol=1e-9 * np.abs(displacement).max(),
    )


@pytest.fixture(scope="module")
def kernels() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(3, 14, 14, 5, 5))


@pytest.fixture(scope="module")
def force_n(tiny_bundle, tiny_data, make_scene, kernels):
    """Forces (frames, 3) of the float pipeline; `force_n("adjoint", divergence=…)`."""

    def run(solver: str, *, clamp: bool = False, source: str | None = None, **poisson) -> np.ndarray:
        depth = [] if solver == "adjoint" else ["depth"]
        force = {"clamp": clamp, "source": source}
        scene = make_scene(outputs=[*depth, "force_xyz"], force=force, poisson={"solver": solver, **poisson})
        weights, trained = kernels, tiny_bundle.pipeline
        if scene.force_from_slopes:
            weights = slope_weights(collapse(kernels), scene.poisson.divergence, scene.sensor.pitch_mm)
        arrays = tiny_bundle.floats | {"force.float_weights": weights}
        return (
            FloatPipeline.from_arrays(arrays, scene, trained.background, trained.rest_depth_mm)
            .run(tiny_data.frames)
            .force_n
        )

    return run


@MODES
@DIVERGENCES
@pytest.mark.parametrize("solver", ["dst2d", "tridiagonal"])
@pytest.mark.quick("dst2d-central-difference", "tridiagonal-backward-absolute")
def test_the_float_pipeline_finds_the_same_force_without_depth(force_n, solver, divergence, mode):
    """Equal up to single precision."""
    expected = force_n(solver, divergence=divergence, mode=mode)
    found = force_n("adjoint", divergence=divergence, mode=mode)
    assert found.shape == (len(expected), 3)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_beside_depth_the_force_of_slopes_is_the_adjoint_s(force_n):
    np.testing.assert_array_equal(force_n("tridiagonal", source="slopes"), force_n("adjoint"))


def test_the_clamp_is_what_the_adjoint_cannot_do(force_n):
    clamped, linear = force_n("dst2d", clamp=True), force_n("adjoint")
    assert np.abs(clamped - linear).max() > 1e-3 * np.abs(linear).max()


@pytest.fixture(scope="module")
def integer(tiny_bundle, make_scene):
    """The integer adjoint with random weights (3, 16, 16, 2), and these."""

    def assembled(bits: int, weights: np.ndarray):
        scene = make_scene(
            outputs=["force_xyz"],
            force={"clamp": False},
            poisson={"solver": "adjoint"},
            numbers={"slope_weight_bits": bits},
        )
        known = tiny_bundle.pipeline
        pipeline = assemble.assemble(
            scene, layers=known.layers, background=known.background, rest_depth_mm=known.rest_depth_mm
        )
        return assemble.with_force(pipeline, weights)

    return assembled


BITS = pytest.mark.parametrize("bits", [6, 12, 18])


@pytest.fixture
def weights() -> np.ndarray:
    return np.random.default_rng(2).normal(size=(3, 16, 16, 2)) * np.array([1, 0.1, 7]).reshape(3, 1, 1, 1)


@BITS
def test_no_force_at_rest_to_the_bit(integer, weights, bits):
    pipeline = integer(bits, weights)
    found = Emulator(pipeline).run(np.repeat(pipeline.background[None], 3, axis=0))
    assert pipeline.force.constant.all()  # what the network finds at rest is not flat
    np.testing.assert_array_equal(found.force_raw, np.zeros((3, 3)))
    np.testing.assert_array_equal(found.force_n, np.zeros((3, 3)))


@BITS
def test_rounded_weights_cost_at_most_half_a_unit_each(integer, weights, tiny_data, bits):
    pipeline = integer(bits, weights)
    found = Emulator(pipeline).run(tiny_data.frames)
    rest = Emulator(pipeline).run(pipeline.background[None]).slopes.astype(float)
    change = found.slopes.astype(float) - rest
    error = np.abs(found.force_n - np.einsum("nijt,aijt->na", change, weights))
    unit = np.abs(weights).max(axis=(1, 2, 3)) / (2 ** (bits - 1) - 1)
    bound = 0.5 * np.abs(change).sum(axis=(1, 2, 3))[:, None] * unit
    assert (error <= bound * (1 + 1e-9)).all()
    assert error.max() > 1e-3 * bound.max()  # rounding there is
