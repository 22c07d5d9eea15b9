from itertools import pairwise

import numpy as np
import pytest

from fastac.models import random_bundle
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import assemble
from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.network import Layer


def network(seed: int, sizes=(6, 16, 16, 16, 3)):
    rng = np.random.default_rng(seed)
    weights = [rng.normal(size=(b, a)) / np.sqrt(a) for a, b in pairwise(sizes)]
    biases = [rng.normal(size=b) * 0.3 for b in sizes[1:]]
    biases[-1][2] += 3  # normals that face the camera, as trained ones do
    return weights, biases


def test_kernels_use_their_range_and_are_to_the_nearest():
    kernels = np.random.default_rng(1).normal(size=(2, 4, 4, 3, 3)) * np.array([1, 7]).reshape(2, 1, 1, 1, 1)
    words, scale = assemble.quantise_weights(kernels, 8)
    assert words.dtype == np.int64
    for axis in range(2):
        assert np.abs(words[axis]).max() == 127
        assert np.abs(words[axis] / scale[axis] - kernels[axis]).max() <= 0.5 / scale[axis]
        assert scale[axis] == pytest.approx(127 / np.abs(kernels[axis]).max())


def test_kernels_of_nothing_stay_nothing():
    words, scale = assemble.quantise_weights(np.zeros((1, 2, 2, 1, 1)), 8)
    assert not words.any()
    assert np.isfinite(scale).all()


def tiny_layers() -> tuple[Layer, ...]:
    """A network of one layer for 4 channels: normals that lean with the brightness."""
    weight = np.array([[20, -5, 0, 3, 0, 0], [0, 8, -20, 1, 0, 0], [0, 0, 0, 0, 1, -1]])
    return (Layer(weight, np.array([0, 0, 3000]), np.array([255] * 4 + [127] * 2)),)


def assembled(scene, rest_mm: float = 0.5):
    background = np.full((scene.sensor.height_px, scene.sensor.width_px, 4), 100, np.uint8)
    v, u = np.indices(background.shape[:2]) / scene.sensor.width_px - 0.5
    return assemble.assemble(
        scene, layers=tiny_layers(), background=background, rest_depth_mm=rest_mm * (1 - u**2 - v**2)
    )


@pytest.mark.parametrize("limit", [1, 2, 4, 8])
def test_slopes_saturate_one_unit_below_the_limit(make_scene, limit):
    pipeline = assembled(make_scene(numbers={"slope_limit": limit, "gradient_fraction_bits": 10}))
    assert pipeline.ratio.fraction == 10
    assert pipeline.ratio.limit == limit * 1024 - 1
    assert pipeline.ratio.normal_width == pipeline.layers[-1].accumulator_width


@pytest.mark.parametrize("bits", [4, 8, 12])
@pytest.mark.parametrize("largest_mm", [0.3, 1.0, 2.0, 3.9])
def test_displacement_words_span_the_largest_displacement(make_scene, bits, largest_mm):
    scene = make_scene(numbers={"displacement_bits": bits}, force={"max_displacement_mm": largest_mm})
    pipeline = assembled(scene)
    unit = pipeline.displacement_mm_per_unit
    assert unit == pytest.approx(
        0.25 * 2.0 ** (pipeline.quantiser.shift - pipeline.solver.depth_format.fraction)
    )
    assert (2**bits - 0.5) * unit >= largest_mm - unit / 2
    assert (2**bits - 1) * unit < 2.1 * largest_mm  # no more than a factor of two is wasted
    assert pipeline.quantiser.input_width == pipeline.depth.width


@pytest.mark.parametrize("divergence", ["central", "backward"])
def test_absolute_depth_has_the_prior_in_its_source(make_scene, divergence):
    pipeline = assembled(make_scene(poisson={"divergence": divergence}))
    unit = 2.0 ** -(14 + (divergence == "central"))
    rest_px = pipeline.rest_depth_mm / 0.25
    prior = pipeline.source.offset * unit
    assert prior[0, 0] == pytest.approx(rest_px[0, 1] + rest_px[1, 0], abs=unit)
    assert prior[5, 13] == pytest.approx(rest_px[6, 15], abs=unit)
    assert not prior[1:-1, 1:-1].any()


def test_difference_mode_subtracts_the_source_at_rest_and_keeps_the_skin(make_scene):
    pipeline = assembled(make_scene(poisson={"mode": "difference"}))
    rest, _ = pipeline.slopes_of(pipeline.background[None])
    p, q = rest[0, ..., 0], rest[0, ..., 1]
    assert pipeline.source.offset[3, 4] == p[4, 6] - p[4, 4] + q[5, 5] - q[3, 5]
    np.testing.assert_allclose(
        pipeline.depth.rest * pipeline.depth_mm_per_unit,
        pipeline.rest_depth_mm[1:-1, 1:-1],
        atol=pipeline.depth_mm_per_unit / 2,
    )


def test_force_units(make_scene):
    """One unit of A_z in newton: Σ k d in integers and in real units."""
    pipeline = assembled(make_scene())
    rng = np.random.default_rng(3)
    kernels = rng.normal(size=(1, 14, 14, 5, 5)) * 0.02
    found = assemble.with_force(pipeline, kernels)
    assert np.abs(found.force.kernel).max() == 127
    words = rng.integers(0, 4096, (14, 14))
    exact = np.zeros(())
    mm = words * found.displacement_mm_per_unit
    padded = np.pad(mm, 2)
    for i, j in np.ndindex(14, 14):
        exact = exact + (kernels[0, i, j] * padded[i : i + 5, j : j + 5]).sum()
    scale = np.abs(kernels).sum() * mm.mean()
    assert found.force(words)[0] * found.force_n_per_unit[0] == pytest.approx(float(exact), abs=2e-3 * scale)
    assert pipeline.force is None  # the first one is left as it was


def test_only_what_the_scene_wants_is_assembled(make_scene):
    normals = assembled(make_scene(outputs=["normals"]))
    for stage in ("source", "solver", "depth", "quantiser", "force", "force_n_per_unit"):
        assert getattr(normals, stage) is None
    depth = assembled(make_scene(outputs=["depth"]))
    assert depth.solver is not None
    for stage in ("quantiser", "force", "force_n_per_unit"):
        assert getattr(depth, stage) is None
    assert assembled(make_scene(outputs=["force_z"])).quantiser is not None


@pytest.mark.parametrize(
    ("solver", "stages"),
    [
        ("dst2d", ("row_forward", "column_forward", "division", "column_inverse", "row_inverse")),
        ("tridiagonal", ("row_forward", "elimination", "substitution", "row_inverse")),
    ],
)
def test_every_stage_of_the_solver_rounds_as_the_scene_says(make_scene, solver, stages):
    for rounding in ("nearest", "floor"):
        scene = make_scene(poisson={"solver": solver}, numbers={"rounding": rounding})
        found = assembled(scene).solver
        assert [getattr(found, name).rounding for name in stages] == [rounding] * len(stages)


def test_too_few_data_bits_are_refused(make_scene):
    scene = make_scene(
        sensor={"geometry": "flat", "height_px": 96, "width_px": 96}, numbers={"data_bits": 12}
    )
    with pytest.raises(ValueError, match="12 data bits cannot hold the bound"):
        assembled(scene)


WITH_DOTS = {
    "adjoint": {"solver": "adjoint"},
    "band": {"solver": "tridiagonal", "kernel": "collapsed", "band_mm": 0.002},
    "patches": {"mode": "difference"},
}


@pytest.fixture(params=WITH_DOTS)
def dotted(request, tmp_path):
    """A pipeline with dots in the force and bridged slopes."""
    settings = WITH_DOTS[request.param]
    scene = random_bundle.scene(("force_xyz",), size=24, dots=True, bridge_dots=True, **settings)
    return random_bundle.random_bundle(tmp_path / "b", scene).pipeline


def test_the_frame_at_rest_has_no_force_at_all(dotted):
    at_rest = Emulator(dotted).run(dotted.background[None])
    assert not at_rest.force_raw.any()
    assert not at_rest.dot_shift_words.any()
    assert at_rest.dots_seen.all()
    assert not at_rest.validity.any()
    moved = Emulator(dotted).run(np.roll(dotted.background, 1, axis=1)[None])
    assert moved.dot_shift_words.any()
    assert moved.force_raw.any(axis=0).all()


def test_dots_join_the_force_in_newton(dotted):
    """One more weight of the dots changes the force by weight times shift."""
    rng = np.random.default_rng(2)
    weights = rng.normal(size=dotted.dot_force.weighted.weight[:, :, 0].shape)
    skin = rng.normal(
        size=dotted.force.weight.shape if hasattr(dotted.force, "weight") else (3, 22, 22, 3, 3)
    )
    frame = np.roll(dotted.background, 1, axis=1)[None]
    none, some = (
        Emulator(assemble.with_force(dotted, skin, values)).run(frame) for values in (0 * weights, weights)
    )
    assert some.dot_shifts_px.any()
    pipeline = assemble.with_force(dotted, skin, weights)
    word_n = pipeline.force_n_per_unit * 2.0**pipeline.dot_force.exponent
    expected = np.einsum("mk,amk->a", some.dot_shifts_px[0], weights)
    words = np.abs(some.dot_shift_words).sum()
    found = (some.force_n - none.force_n)[0]
    assert (np.abs(found - expected) <= word_n / 2 * words + 1e-12).all()
    assert pipeline.force_bound == pipeline.force.bound + pipeline.dot_force.bound
    assert pipeline.force_bound < 1 << (pipeline.force_width - 1)


def test_dots_and_bridge_are_as_loadable_as_the_weights(make_scene, tmp_path):
    for weights in ("loadable", "baked"):
        scene = random_bundle.scene(("force_z",), dots=True, bridge_dots=True, weights=weights)
        found = random_bundle.random_bundle(tmp_path / weights, scene).pipeline
        expected = weights == "loadable"
        assert found.follower.windows.loadable == found.bridge.windows.loadable == expected
    plain = assembled(make_scene())
    assert (plain.bridge, plain.follower, plain.dot_force, plain.validity.dots) == (None, None, None, 0)
    assert found.validity.dots == len(found.follower.rest) == 4


def test_another_network_keeps_the_dots_force(dotted, tmp_path):
    known = random_bundle.Bundle(dotted, {}, "0" * 64)
    found = random_bundle.recalibrated(tmp_path / "other", known).pipeline
    assert found.dot_force is dotted.dot_force
    assert np.array_equal(found.follower.guides, dotted.follower.guides)
    moved = found.follower.rest - dotted.follower.rest
    assert 0 < np.abs(moved).max() <= random_bundle.MOVED_PX << FRACTION
    assert (found.follower.low < dotted.follower.low).all()
    assert (found.follower.high > dotted.follower.high).all()
    assert np.array_equal(found.follower.windows.threshold, found.bridge.windows.threshold)
    assert (found.follower.windows.threshold != dotted.follower.windows.threshold).all()
