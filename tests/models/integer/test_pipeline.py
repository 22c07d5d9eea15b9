from dataclasses import replace

import numpy as np
import pytest

from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import assemble, quantise
from fastac.models.integer.dst2d import Solver
from fastac.models.integer.laplacian import divergence_of
from fastac.models.loops.frames import CHUNK
from fastac.models.result import Result, concatenate

STAGES = ("source", "solver", "depth", "quantiser", "force", "force_n_per_unit")


@pytest.fixture(scope="module")
def build(tiny_bundle, make_scene):
    """The trained layers and kernels under other settings of the scene."""

    def pipeline(**changes):
        scene = make_scene(**changes)
        trained = tiny_bundle.pipeline
        made = assemble.assemble(
            scene, layers=trained.layers, background=trained.background, rest_depth_mm=trained.rest_depth_mm
        )
        if scene.wants_force:
            made = assemble.with_force(made, tiny_bundle.floats["force.float_weights"].astype(float))
        return made

    return pipeline


def present(result: Result) -> dict[str, np.ndarray]:
    """What the scene wanted."""
    return {name: value for name, value in vars(result).items() if value is not None}


MODES = pytest.mark.parametrize("mode", ["absolute", "difference"])
DIVERGENCES = pytest.mark.parametrize("divergence", ["central", "backward"])


@MODES
@DIVERGENCES
def test_run_is_the_stages_one_after_another(build, tiny_data, mode, divergence):
    pipeline = build(poisson={"mode": mode, "divergence": divergence})
    frames = tiny_data.frames[:3]
    found = Emulator(pipeline).run(frames)
    for k, frame in enumerate(frames):
        # Features, then layer by layer, pixel by pixel in the order of the rows.
        change = frame.astype(int) - pipeline.background.astype(int)
        place = np.rint(np.linspace(-127, 127, 16)).astype(int)
        u, v = np.meshgrid(place, place)
        x = np.concatenate([change, u[..., None], v[..., None]], axis=-1).reshape(-1, 6)
        for layer in pipeline.layers:
            x = x @ layer.weight.T + layer.bias
            if layer.requantisation is not None:
                scale = layer.requantisation
                x = np.minimum(np.maximum(x, 0) * scale.multiplier // 2**scale.shift, 127)
        words = x.reshape(16, 16, 3)
        np.testing.assert_array_equal(found.normal_words[k], words)
        length = np.sqrt((words.astype(float) ** 2).sum(axis=-1, keepdims=True))
        np.testing.assert_allclose(found.normals[k], words / length, atol=1e-6)
        slopes, saturated = pipeline.ratio(words)
        np.testing.assert_array_equal(found.slopes[k], (slopes / 2**14).astype(np.float32))
        assert found.gradient_saturated[k] == saturated.sum()

        source = divergence_of(slopes, divergence) - pipeline.source.offset
        z = pipeline.solver(source[None])[0]
        if mode == "absolute":
            depth, displacement = z, pipeline.depth.rest - z
        else:
            depth, displacement = z + pipeline.depth.rest, -z
        np.testing.assert_array_equal(found.depth_words[k], depth)
        unit_mm = 0.25 / 2**pipeline.solver.depth_format.fraction
        np.testing.assert_allclose(found.depth_mm[k, 1:-1, 1:-1], depth * unit_mm, atol=1e-6)
        np.testing.assert_allclose(found.displacement_mm[k], displacement * unit_mm, atol=1e-6)

        half = (1 << pipeline.quantiser.shift) >> 1
        top = 2**pipeline.scene.numbers.displacement_bits - 1
        q = np.clip((np.maximum(displacement, 0) + half) >> pipeline.quantiser.shift, 0, top)
        np.testing.assert_array_equal(found.displacement_words[k], q)
        padded = np.pad(q, 2)
        total = sum(
            int((pipeline.force.kernel[0, i, j] * padded[i : i + 5, j : j + 5]).sum())
            for i, j in np.ndindex(14, 14)
        )
        assert found.force_raw[k, 0] == total
        assert found.force_n[k, 0] == pytest.approx(total * pipeline.force_n_per_unit)


@MODES
@DIVERGENCES
def test_the_background_is_exactly_at_rest(build, mode, divergence):
    pipeline = build(poisson={"mode": mode, "divergence": divergence})
    found = Emulator(pipeline).run(pipeline.background[None])
    assert not found.displacement_mm.any()
    assert not found.displacement_words.any()
    assert not found.force_raw.any()
    assert not found.force_n.any()
    if mode == "difference":  # and the depth is the known skin's, to the word
        assert np.abs(found.depth_mm[0] - pipeline.rest_depth_mm).max() < pipeline.depth_mm_per_unit


def test_a_dimmer_background_is_at_rest_too(build):
    """Another unit of the sensor, or the same one years later: only changes count."""
    pipeline = build()
    dimmer = (pipeline.background * 0.8).astype(np.uint8)
    assert not Emulator(replace(pipeline, background=dimmer)).run(dimmer[None]).force_raw.any()
    assert Emulator(pipeline).run(dimmer[None]).force_raw.any()


@MODES
def test_presses_displace_towards_the_camera(build, tiny_data, mode):
    found = Emulator(build(poisson={"mode": mode})).run(tiny_data.frames)
    truth = (tiny_data.rest_depth_mm - tiny_data.depth_mm)[:, 1:-1, 1:-1]
    assert np.abs(found.displacement_mm - truth).mean() < 0.01
    # Presses of less than a pixel, seen by 16 px after 15 epochs: their sign and order of magnitude.
    ratio = found.displacement_mm.max(axis=(1, 2)) / truth.max(axis=(1, 2))
    assert ratio.min() > 0.5
    assert ratio.max() < 1.2
    for value in present(found).values():
        assert np.isfinite(value).all()
    np.testing.assert_array_equal(
        found.depth_mm[:, [0, -1]], np.tile(tiny_data.rest_depth_mm[[0, -1]], (len(truth), 1, 1))
    )


@pytest.mark.parametrize("value", [0, 255])
@MODES
def test_impossible_frames_leave_no_nan_and_say_what_saturated(build, mode, value):
    pipeline = build(poisson={"mode": mode}, force={"max_displacement_mm": 0.05})
    rng = np.random.default_rng(1)
    frames = np.stack(
        [
            np.full_like(pipeline.background, value),
            rng.integers(0, 256, pipeline.background.shape, dtype=np.uint8),
        ]
    )
    found = Emulator(pipeline).run(frames)
    for name, array in present(found).items():
        assert np.isfinite(array).all(), name
    slopes, saturated = pipeline.ratio(found.normal_words.astype(np.int64))
    np.testing.assert_array_equal(found.gradient_saturated, saturated.sum(axis=(1, 2, 3)))
    assert np.abs(slopes).max() <= pipeline.ratio.limit
    highest = 2**pipeline.scene.numbers.displacement_bits - 0.5
    over = found.displacement_mm > highest * pipeline.displacement_mm_per_unit
    np.testing.assert_allclose(found.displacement_saturated, over.sum(axis=(1, 2)), atol=2)
    assert found.displacement_saturated.any()


def test_chunks_change_nothing(build, tiny_data):
    """More frames than one chunk, and a last chunk that is not full."""
    pipeline = build()
    count = 2 * CHUNK + 2
    frames = np.concatenate([tiny_data.frames, tiny_data.frames])[:count]
    whole = Emulator(pipeline).run(frames)
    for k in (0, CHUNK - 1, CHUNK, count - 1):
        alone = Emulator(pipeline).run(frames[k : k + 1])
        for name, array in present(whole).items():
            np.testing.assert_array_equal(array[k], getattr(alone, name)[0])


def test_join_keeps_what_is_absent_absent():
    one = Result(normals=np.ones((2, 3)), slopes=np.zeros((2, 2)), force_n=np.ones((2, 1)))
    found = concatenate([one, one, one])
    assert found.normals.shape == (6, 3)
    assert found.force_n.shape == (6, 1)
    assert found.depth_mm is None


@pytest.mark.parametrize(
    ("outputs", "stages", "results"),
    [
        (["normals"], (), ()),
        (["depth"], ("source", "solver", "depth"), ("depth_mm", "displacement_mm", "depth_words")),
        (["normals", "depth"], ("source", "solver", "depth"), ("depth_mm", "displacement_mm", "depth_words")),
        (
            ["force_z"],
            STAGES,
            (
                "depth_mm",
                "displacement_mm",
                "depth_words",
                "displacement_words",
                "displacement_saturated",
                "force_raw",
                "force_n",
            ),
        ),
    ],
)
def test_only_what_the_scene_wants_is_there(build, tiny_data, monkeypatch, outputs, stages, results):
    if not stages:  # nothing may even be solved

        def refuse(*_, **__):
            raise AssertionError("the scene wants no depth")

        monkeypatch.setattr(Solver, "fitted", refuse)
        monkeypatch.setattr(assemble, "PoissonSource", refuse)
    pipeline = build(outputs=outputs)
    assert {stage for stage in STAGES if getattr(pipeline, stage) is not None} == set(stages)
    found = Emulator(pipeline).run(tiny_data.frames[:2])
    always = {"normals", "slopes", "normal_words", "gradient_saturated", "validity_measures", "validity"}
    assert {name for name, value in vars(found).items() if value is not None} == always | set(results)


def test_images_need_not_be_square_without_a_solver(make_scene):
    scene = make_scene(outputs=["normals"], sensor={"height_px": 18, "width_px": 24})
    rng = np.random.default_rng(1)
    background = rng.integers(0, 256, (18, 24, 4), dtype=np.uint8)
    weight = np.array([[9, 0, 0, 0, 1, 0], [0, 9, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0]])
    layer = quantise.Layer(weight, np.array([0, 0, 5000]), np.array([255] * 4 + [127] * 2))
    pipeline = assemble.assemble(
        scene, layers=(layer,), background=background, rest_depth_mm=np.zeros((18, 24))
    )
    words = Emulator(pipeline).run(background[None]).normal_words[0]
    assert words.shape == (18, 24, 3)
    assert words[0, -1].tolist() == [127, -127, 5000]
    assert words[-1, 0].tolist() == [-127, 127, 5000]
