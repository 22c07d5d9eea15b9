from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve

from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating import pipeline as float_pipeline
from fastac.models.floating.network import predict, slopes_of
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import assemble
from fastac.models.integer.features import integer_features
from fastac.models.loops.frames import CHUNK
from fastac.models.vision.rigid_spread import rigid_spread_px
from fastac.scenes.model_schema import Slip

PITCH_MM = 0.25


@pytest.fixture(scope="module")
def pair(tiny_bundle, make_scene):
    """The float and the integer pipeline of the trained model under other settings of the scene."""

    def pipelines(**changes):
        scene = make_scene(**changes)
        trained = tiny_bundle.pipeline
        rest, background = trained.rest_depth_mm, trained.background
        whole = FloatPipeline.from_arrays(tiny_bundle.floats, scene, background, rest)
        integer = assemble.assemble(scene, layers=trained.layers, background=background, rest_depth_mm=rest)
        if scene.wants_force:
            integer = assemble.with_force(integer, tiny_bundle.floats["force.float_weights"].astype(float))
        return whole, integer

    return pipelines


MODES = pytest.mark.parametrize("mode", ["absolute", "difference"])
DIVERGENCES = pytest.mark.parametrize("divergence", ["central", "backward"])


def source_px(slopes: np.ndarray, divergence: str) -> np.ndarray:
    p, q = slopes[..., 0].astype(float), slopes[..., 1].astype(float)
    if divergence == "central":
        return (p[1:-1, 2:] - p[1:-1, :-2] + q[2:, 1:-1] - q[:-2, 1:-1]) / 2
    return p[1:-1, 1:-1] - p[1:-1, :-2] + q[1:-1, 1:-1] - q[:-2, 1:-1]


def directly(source: np.ndarray, boundary: np.ndarray) -> np.ndarray:
    """Poisson's equation with Dirichlet values `boundary` (H, W) by a sparse solver, in px."""
    n = len(source)
    one = diags_array([np.ones(n - 1), np.full(n, -2.0), np.ones(n - 1)], offsets=[-1, 0, 1])
    right = source.copy()
    right[0] -= boundary[0, 1:-1]
    right[-1] -= boundary[-1, 1:-1]
    right[:, 0] -= boundary[1:-1, 0]
    right[:, -1] -= boundary[1:-1, -1]
    matrix = (kron(one, eye_array(n)) + kron(eye_array(n), one)).tocsc()
    return spsolve(matrix, right.ravel()).reshape(n, n)


@MODES
@DIVERGENCES
def test_depth_and_force_are_those_of_a_direct_solver(pair, tiny_bundle, tiny_data, mode, divergence):
    pipeline, _ = pair(poisson={"mode": mode, "divergence": divergence})
    rest = pipeline.rest_depth_mm / PITCH_MM
    at_rest = pipeline.run(pipeline.background[None])
    found = pipeline.run(tiny_data.frames[:4])
    source_at_rest = source_px(at_rest.slopes[0], divergence)
    kernels = tiny_bundle.floats["force.float_weights"].astype(float)
    for k in range(4):
        source = source_px(found.slopes[k], divergence)
        if mode == "absolute":
            z = directly(source, rest)
            zero = directly(source_at_rest, rest)
        else:
            z = directly(source - source_at_rest, np.zeros_like(rest)) + rest[1:-1, 1:-1]
            zero = rest[1:-1, 1:-1]
        np.testing.assert_allclose(found.depth_mm[k, 1:-1, 1:-1], z * PITCH_MM, atol=1e-5)
        displacement = (zero - z) * PITCH_MM
        np.testing.assert_allclose(found.displacement_mm[k], displacement, atol=1e-5)
        padded = np.pad(np.maximum(displacement, 0), 2)
        force = sum((kernels[0, i, j] * padded[i : i + 5, j : j + 5]).sum() for i, j in np.ndindex(14, 14))
        assert found.force_n[k, 0] == pytest.approx(force, abs=1e-6)


def test_normals_and_slopes_are_the_network_s(pair, tiny_data):
    pipeline, _ = pair()
    found = pipeline.run(tiny_data.frames[:2])
    change = tiny_data.frames[:2].astype(int) - tiny_data.background
    place = np.rint(np.linspace(-127, 127, 16)).astype(int)
    u, v = np.meshgrid(place, place)
    coordinates = np.broadcast_to(np.stack([u, v], axis=-1), (2, 16, 16, 2))
    normal = predict(pipeline.network, np.concatenate([change, coordinates], axis=-1))
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=-1), 1, atol=1e-6)
    np.testing.assert_allclose(
        found.normals, normal / np.linalg.norm(normal, axis=-1, keepdims=True), atol=1e-6
    )
    np.testing.assert_allclose(found.slopes, -normal[..., :2] / normal[..., 2:], atol=1e-6)


@pytest.mark.parametrize("window_px", [2, 8])
def test_the_network_sees_smoothed_differences(pair, tiny_data, window_px):
    pipeline, _ = pair(network={"smoothing_px": window_px})
    found = pipeline.run(tiny_data.frames[:2])
    seen = integer_features(tiny_data.frames[:2], tiny_data.background, window_px)
    normal = predict(pipeline.network, seen)
    np.testing.assert_allclose(found.slopes, -normal[..., :2] / normal[..., 2:], atol=1e-6)
    assert np.abs(found.slopes - pair()[0].run(tiny_data.frames[:2]).slopes).max() > 0.01


@MODES
@DIVERGENCES
def test_float_and_integer_agree(pair, tiny_data, mode, divergence):
    """Bounds for a model with three epochs of fine-tuning, presses of 0.1 to 0.2 mm and pixels of 250 µm."""
    floating, tables = pair(poisson={"mode": mode, "divergence": divergence})
    whole, integer = floating.run(tiny_data.frames), Emulator(tables).run(tiny_data.frames)
    cosine = (whole.normals * integer.normals).sum(axis=-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 0.6
    assert np.abs(whole.slopes - integer.slopes).mean() < 0.01
    assert np.abs(whole.depth_mm - integer.depth_mm).mean() < 0.003
    assert np.abs(whole.displacement_mm - integer.displacement_mm).mean() < 0.003
    assert np.abs(whole.force_n - integer.force_n).max() < 0.1 * np.abs(whole.force_n).max()


def test_only_quantisation_separates_them(pair, tiny_data):
    """With the same slopes in both, only the roundings of solver and displacement differ."""
    whole, integer = pair()
    slopes = Emulator(integer).run(tiny_data.frames).slopes.astype(float)
    z = whole._solve(slopes)
    found = Emulator(integer).run(tiny_data.frames).depth_mm[:, 1:-1, 1:-1]
    assert np.abs(z * PITCH_MM - found).max() < 2e-4


@MODES
def test_the_background_is_at_rest(pair, mode):
    pipeline, _ = pair(poisson={"mode": mode})
    found = pipeline.run(pipeline.background[None])
    assert np.abs(found.displacement_mm).max() < 1e-12
    assert np.abs(found.force_n).max() < 1e-12


def test_the_modes_differ_by_what_the_network_gets_wrong_at_rest(pair, tiny_data):
    """Absolute depth includes the integral of the network's error on the background, the difference does
    not."""
    absolute, _ = pair(poisson={"mode": "absolute"})
    difference, _ = pair(poisson={"mode": "difference"})
    a, d = (p.run(tiny_data.frames[:3]) for p in (absolute, difference))
    np.testing.assert_allclose(a.displacement_mm, d.displacement_mm, atol=1e-6)
    error = absolute.rest_px() * PITCH_MM - absolute.rest_depth_mm[1:-1, 1:-1]
    assert np.abs(error).max() > 1e-4
    np.testing.assert_allclose(
        (a.depth_mm - d.depth_mm)[:, 1:-1, 1:-1], np.broadcast_to(error, (3, 14, 14)), atol=1e-6
    )


def test_from_bundle_has_the_bundle_s_parts(tiny_bundle, tiny_data):
    pipeline = FloatPipeline.from_bundle(tiny_bundle)
    for k, layer in enumerate(pipeline.network.linear_layers):
        np.testing.assert_array_equal(layer.weight.detach(), tiny_bundle.floats[f"network.{k}.weight"])
        np.testing.assert_array_equal(layer.bias.detach(), tiny_bundle.floats[f"network.{k}.bias"])
    assert pipeline.force_weights.shape == (1, 14, 14, 5, 5)
    np.testing.assert_array_equal(pipeline.background, tiny_data.background)


def test_no_depth_wanted_no_solver_run(pair, tiny_data, monkeypatch):
    pipeline, _ = pair(outputs=["normals"])

    def refuse(*_):
        raise AssertionError("the scene wants no depth")

    monkeypatch.setattr(float_pipeline, "solve", refuse)
    found = pipeline.run(tiny_data.frames[:2])
    present = {name for name, value in vars(found).items() if value is not None}
    assert present == {"normals", "slopes"}
    with pytest.raises(AssertionError, match="wants no depth"):
        replace(pipeline, scene=pipeline.scene.model_copy(update={"outputs": ("depth",)})).run(
            tiny_data.frames[:2]
        )


def test_no_kernels_no_force(tiny_bundle, make_scene, tiny_data):
    floats = {k: v for k, v in tiny_bundle.floats.items() if not k.startswith("force.")}
    trained = tiny_bundle.pipeline
    pipeline = FloatPipeline.from_arrays(
        floats, make_scene(outputs=["depth"]), trained.background, trained.rest_depth_mm
    )
    found = pipeline.run(tiny_data.frames[:2])
    assert found.force_n is None
    assert found.depth_mm is not None


@pytest.mark.parametrize("towards", [-3.0, -0.5, 0.0])
def test_a_surface_that_turns_away(tiny_bundle, tiny_data, towards):
    """Where n_z <= 0 the slope is the limit in the direction of n."""
    floats = dict(tiny_bundle.floats)
    last = max(name for name in floats if name.startswith("network.") and name.endswith(".bias"))
    floats[last] = np.array([0, 0, towards], np.float32)
    trained = tiny_bundle.pipeline
    pipeline = FloatPipeline.from_arrays(floats, trained.scene, trained.background, trained.rest_depth_mm)
    frames = tiny_data.frames[:3]
    normal = predict(pipeline.network, integer_features(frames, pipeline.background))
    assert (normal[..., 2] <= 0).any()
    limit = pipeline.scene.numbers.slope_limit
    found = pipeline.run(frames, wanted=["slopes"]).slopes
    sure = np.abs(normal[..., 2]) > 0.01  # elsewhere the last bits decide
    np.testing.assert_allclose(found[sure], slopes_of(normal, limit)[sure], atol=1e-4)
    assert np.abs(found).max() <= limit


def test_chunks_and_choices_change_nothing(tiny_bundle, tiny_data):
    pipeline = FloatPipeline.from_bundle(tiny_bundle)
    frames = np.concatenate([tiny_data.frames, tiny_data.frames])[: 2 * CHUNK + 3]
    whole = {name: value for name, value in vars(pipeline.run(frames)).items() if value is not None}
    for name, values in whole.items():
        found = pipeline.run(frames, wanted=[name])
        assert [key for key, value in vars(found).items() if value is not None] == [name]
        np.testing.assert_array_equal(getattr(found, name), values)
        alone = pipeline.run(frames[CHUNK : CHUNK + 1], wanted=[name])
        np.testing.assert_allclose(getattr(alone, name)[0], values[CHUNK], atol=1e-6)
    with pytest.raises(ValueError, match="wanted 'force_raw': expected some of normals, slopes, depth_mm"):
        pipeline.run(frames, wanted=["force_raw"])
    with pytest.raises(ValueError, match=r"expected \(16, 16, 4\) uint8 each"):
        pipeline.run(frames[:, 1:])


def test_the_stages_are_those_of_run(tiny_bundle, tiny_data):
    pipeline = FloatPipeline.from_bundle(tiny_bundle)
    stages, result = pipeline.stages(), pipeline.run(tiny_data.frames[:3])
    assert list(stages) == ["normals", "depth", "force"]
    for k, frame in enumerate(tiny_data.frames[:3]):
        slopes = stages["normals"](frame)
        np.testing.assert_array_equal(slopes, result.slopes[k])
        displacement = stages["depth"](slopes)
        np.testing.assert_allclose(displacement, result.displacement_mm[k], atol=1e-6)
        np.testing.assert_allclose(stages["force"](displacement), result.force_n[k], rtol=1e-5)
    without = replace(pipeline, force_weights=None)
    assert list(without.stages()) == ["normals", "depth"]


class TestDots:
    """A scene with bridged slopes, dots in the force, and bends."""

    @pytest.fixture
    def both(self, dotted_bundle):
        """With the same weights of the force: those that were trained follow each one's own errors."""
        weights = np.random.default_rng(1).uniform(0.5, 1.5, (1, 30, 30, 4))
        of_dots = np.random.default_rng(2).normal(size=(1, 9, 2))
        floating = FloatPipeline.from_bundle(dotted_bundle)
        integer = assemble.with_force(dotted_bundle.pipeline, weights, of_dots)
        return replace(floating, force_weights=weights, dot_weights=of_dots), Emulator(integer)

    def test_force_is_from_displacement_and_shifts_by_the_definition(self, both, dotted_data):
        floating, _ = both
        found = floating.run(dotted_data.frames[:6])
        d, (band, deep) = found.displacement_mm.astype(float), floating.scene.force.bends_mm
        weights, of_dots = floating.force_weights, floating.dot_weights
        contact, bulge = np.where(d > band, d - band, 0), np.where(d < -band, d + band, 0)
        expected = np.zeros((6, 1))
        for term, values in enumerate((d, contact, bulge, np.where(d > deep, d - deep, 0))):
            assert values.any()
            expected += np.einsum("fij,aij->fa", values, weights[..., term])
        expected += np.einsum("fmk,amk->fa", found.dot_shifts_px, of_dots)
        np.testing.assert_allclose(found.force_n, expected, atol=1e-5 * np.abs(expected).max())
        without = replace(floating, dot_weights=None).run(dotted_data.frames[:6], wanted=["force_n"]).force_n
        share = np.einsum("fmk,amk->fa", found.dot_shifts_px, of_dots)
        assert np.abs(share).max() > 1e-3 * np.abs(expected).max()
        np.testing.assert_allclose(found.force_n - without, share, atol=1e-5 * np.abs(expected).max())

    def test_shifts_are_near_the_integers(self, both, dotted_data):
        whole, integer = (pipeline.run(dotted_data.frames) for pipeline in both)
        np.testing.assert_array_equal(whole.dots_seen, integer.dots_seen)
        assert whole.dots_seen.all()
        assert np.abs(whole.dot_shifts_px - integer.dot_shifts_px).max() < 0.2
        assert np.abs(whole.slopes - integer.slopes).mean() < 0.02
        assert np.abs(whole.force_n - integer.force_n).mean() < 0.1 * np.abs(whole.force_n).mean()

    def test_slopes_under_dots_are_those_of_the_skin_beside_them(self, both, dotted_data):
        floating, _ = both
        frames = dotted_data.frames[:3]
        bare = replace(floating, bridge=None).run(frames, wanted=["slopes"]).slopes
        found = floating.run(frames, wanted=["slopes"]).slopes
        dark = floating.bridge.dark(frames)
        np.testing.assert_array_equal(found, floating.bridge(bare, dark))
        assert (found[dark] != bare[dark]).any()

    def test_slip_is_the_spread_of_the_dots_that_touch(self, both, dotted_data):
        floating, integer = self.with_slip(*both)
        frames = dotted_data.frames.copy()
        frames[:, :14] = np.roll(frames[:, :14], 1, axis=2)  # the upper dots move to the right
        found = floating.run(frames)
        rest, contact_mm = floating.dots.rest_px, floating.scene.slip.contact_mm
        column, row = np.rint(rest).astype(int).T - 1
        counts = []
        for k in range(len(frames)):
            touches = found.dots_seen[k] & (found.displacement_mm[k, row, column] > contact_mm)
            expected = rigid_spread_px(rest[touches], found.dot_shifts_px[k, touches])
            assert found.slip_px[k] == pytest.approx(expected, abs=1e-6)
            counts.append(touches.sum())
        assert min(counts) < 3 < max(counts)
        integers = integer.run(frames, wanted=["slip_px", "slip_dots"])
        assert np.abs(counts - integers.slip_dots).mean() < 0.5
        beyond = found.slip_px > 0.2
        assert beyond.sum() > 10
        difference = found.slip_px - integers.slip_px
        assert np.abs(np.median(difference[beyond])) < 0.05

    @staticmethod
    def with_slip(floating, emulator):
        """Both with the output slip, whose limit of contact is small."""
        scene = floating.scene
        changes = {"outputs": (*scene.outputs, "slip"), "slip": Slip(contact_mm=0.01)}
        wanted = scene.model_copy(update=changes)
        integer = emulator.pipeline.replace(scene=wanted)
        return replace(floating, scene=wanted), Emulator(integer)

    def test_the_background_has_no_force_and_each_output_is_had_alone(self, both, dotted_data):
        floating, _ = self.with_slip(*both)
        at_rest = floating.run(floating.background[None])
        assert np.abs(at_rest.force_n).max() < 1e-12
        assert not at_rest.dot_shifts_px.any()
        assert not at_rest.slip_px.any()
        whole = floating.run(dotted_data.frames[:3])
        for name in ("dot_shifts_px", "dots_seen", "force_n", "slip_px"):
            alone = floating.run(dotted_data.frames[:3], wanted=[name])
            assert [key for key, value in vars(alone).items() if value is not None] == [name]
            np.testing.assert_array_equal(getattr(alone, name), getattr(whole, name))


@pytest.mark.parametrize("solver", ["dst2d", "adjoint"])
def test_the_same_values_by_any_number_of_threads(pair, tiny_data, monkeypatch, solver):
    """Bit for bit, whether a frame comes alone or with others."""
    changes = {} if solver == "dst2d" else {"outputs": ["normals"]}
    pipeline, _ = pair(**changes)
    if solver == "adjoint":
        scene = pipeline.scene.model_copy(
            update={
                "outputs": ("force_z",),
                "poisson": pipeline.scene.poisson.model_copy(update={"solver": solver}),
                "force": pipeline.scene.force.model_copy(update={"clamp": False, "fit": "slopes"}),
            }
        )
        weights = np.random.default_rng(1).normal(size=(1, 16, 16, 2))
        pipeline = replace(pipeline, scene=scene, force_weights=weights)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    frames = tiny_data.frames[:5]
    expected = {name: value for name, value in vars(pipeline.run(frames)).items() if value is not None}
    assert "force_n" in expected
    for threads in ("2", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        for part in (slice(5), slice(0, 1), slice(3, 4)):
            found = pipeline.run(frames[part])
            for name, values in expected.items():
                assert getattr(found, name).tobytes() == values[part].tobytes(), name
