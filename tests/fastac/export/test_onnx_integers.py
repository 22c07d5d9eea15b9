"""The integer pipeline as ONNX under onnxruntime: equal to the emulator on every value, by every scene."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

from onnx import helper

from fastac.export import onnx_check
from fastac.export.graph import Graph
from fastac.export.integer_graph import slopes_of
from fastac.export.onnx_file import ExportError, model_of
from fastac.export.pixel_stages import smoothed
from fastac.models import random_bundle
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import smoothing
from fastac.models.integer.network import GradientRatio
from fastac.models.integer.words import FLOOR, NEAREST, round_shift

DEPTH, Z, XYZ = "depth", "force_z", "force_xyz"
MAP = ("force_z", "force_map")
FULL = {"displacement_bits": 16}
"""The scene's own word lengths."""

SCENES = {
    "normals": random_bundle.scene(("normals",)),
    "normals, narrow slopes": random_bundle.scene(
        ("normals",), numbers=random_bundle.NUMBERS | {"slope_limit": 1}
    ),
    "dst2d": random_bundle.scene((DEPTH, Z)),
    "dst2d, full words": random_bundle.scene(("normals", DEPTH, XYZ), numbers=FULL, channels="bgr+nir"),
    "dst2d, difference": random_bundle.scene((DEPTH, Z), mode="difference", divergence="backward"),
    "dst2d, floor": random_bundle.scene((DEPTH,), rounding="floor"),
    "dst2d, no clamp": random_bundle.scene((XYZ,), clamp=False, kernel="collapsed"),
    "tridiagonal": random_bundle.scene((DEPTH, Z), solver="tridiagonal"),
    "tridiagonal, full words": random_bundle.scene((DEPTH, XYZ), solver="tridiagonal", numbers=FULL),
    "tridiagonal, floor, difference": random_bundle.scene(
        (DEPTH, Z), solver="tridiagonal", rounding="floor", mode="difference", size=20
    ),
    "force map": random_bundle.scene((DEPTH, *MAP), kernel_size=5),
    "force map, no clamp": random_bundle.scene(MAP, clamp=False, solver="tridiagonal"),
    "collapsed kernels": random_bundle.scene((Z,), kernel="collapsed"),
    "weights with bends": random_bundle.scene(
        (XYZ,), kernel="collapsed", clamp=False, band_mm=0.001, deep_mm=(0.004, 0.006)
    ),
    "adjoint": random_bundle.scene((XYZ,), solver="adjoint", kernel="collapsed"),
    "slopes beside depth": random_bundle.scene((DEPTH, XYZ), solver="tridiagonal", source="slopes"),
    "adjoint, baked": random_bundle.scene(
        ("normals", Z), solver="adjoint", kernel="collapsed", weights="baked"
    ),
    "bridged slopes": random_bundle.scene((DEPTH, Z), bridge_dots=True),
    "bridged slopes, adjoint": random_bundle.scene(
        (Z,), solver="adjoint", kernel="collapsed", bridge_dots=True
    ),
    "smoothed over 4 px": random_bundle.scene((DEPTH, Z), smoothing_px=4),
    "smoothed over 8 px": random_bundle.scene(
        ("normals", XYZ), solver="tridiagonal", channels="bgr+nir", size=20, lanes=4, smoothing_px=8
    ),
}


@pytest.fixture(params=SCENES, scope="module")
def bundle(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("onnx") / "bundle"
    return random_bundle.random_bundle(folder, SCENES[request.param], hidden=(4, 5))


def session_of(bundle, **options):
    return onnx_check.session_of(model_of(bundle, **options), threads=1)


def steep(bundle):
    """The bundle with a network whose normals point away from the camera at many pixels."""
    *hidden, last = bundle.pipeline.layers
    layers = (*hidden, replace(last, bias=last.bias * np.array([1, 1, 0])))
    return replace(bundle, pipeline=bundle.pipeline.replace(layers=layers))


@pytest.mark.parametrize("saturates", [False, True])
def test_every_value_is_the_emulators(bundle, saturates):
    bundle = steep(bundle) if saturates else bundle
    frames = onnx_check.extreme_frames(bundle.pipeline.background)
    session = session_of(bundle)
    found = onnx_check.run(session, frames, bundle.pipeline.background)
    known = Emulator(bundle.pipeline).run(frames)
    assert known.gradient_saturated.any() or not saturates
    assert "force_map_raw" in found or not bundle.scene.wants_force_map
    words = {"normal_words", "slope_words", "validity"}
    if bundle.scene.wants_solver:
        words |= {"depth_words", "depth_mm", "displacement_mm"}
    if bundle.scene.wants_force:
        words |= {"force_raw", "force_n"}
    assert words <= found.keys()
    for name, values in found.items():
        if name == "slope_words":
            expected = (known.slopes.astype(np.float64) * 2.0**bundle.pipeline.ratio.fraction).astype(
                np.int32
            )
        else:
            expected = getattr(known, name)
            assert expected.dtype == values.dtype, name
        np.testing.assert_array_equal(values, expected, err_msg=name)
    compared = onnx_check.compare(bundle, session, "integer", frames)
    assert (compared.values, compared.different) == (sum(value.size for value in found.values()), 0)


def test_displacements_saturate_in_these_frames(tmp_path):
    """So that the comparison above is one of saturated words too."""
    bundle = random_bundle.random_bundle(tmp_path / "b", SCENES["dst2d"])
    frames = onnx_check.extreme_frames(bundle.pipeline.background)
    assert Emulator(bundle.pipeline).run(frames).displacement_saturated.any()


def test_a_difference_is_found(tmp_path):
    bundle = random_bundle.random_bundle(tmp_path / "b", SCENES["dst2d"])
    layer = bundle.pipeline.layers[-1]
    changed = replace(layer, bias=layer.bias + np.array([0, 1, 0]))
    pipeline = bundle.pipeline.replace(layers=(*bundle.pipeline.layers[:-1], changed))
    frames = onnx_check.extreme_frames(bundle.pipeline.background)
    found = onnx_check.compare(replace(bundle, pipeline=pipeline), session_of(bundle), "integer", frames)
    assert found.different > 0
    assert found.first == "normal_words"


def test_the_background_as_an_input(tmp_path):
    """Frames against another background, as `TactileSensor.with_background` sees them."""
    bundle = random_bundle.random_bundle(tmp_path / "b", SCENES["dst2d"])
    session = session_of(bundle, background_input=True)
    assert [value.name for value in session.get_inputs()] == ["frame", "background"]
    frames = onnx_check.extreme_frames(bundle.pipeline.background)
    other = np.clip(bundle.pipeline.background.astype(int) + 7, 0, 255).astype(np.uint8)
    found = onnx_check.run(session, frames, other)
    known = Emulator(bundle.pipeline.replace(background=other)).run(frames)
    for name in ("normal_words", "depth_words", "force_raw", "validity"):
        np.testing.assert_array_equal(found[name], getattr(known, name), err_msg=name)


@pytest.mark.parametrize("count", [1, 3])
def test_any_number_of_frames(tmp_path, count):
    bundle = random_bundle.random_bundle(tmp_path / "b", SCENES["tridiagonal"])
    frames = onnx_check.extreme_frames(bundle.pipeline.background)[:count]
    assert onnx_check.compare(bundle, session_of(bundle), "integer", frames).different == 0


def test_the_file_says_what_it_is(tmp_path):
    bundle = random_bundle.random_bundle(tmp_path / "b", SCENES["dst2d"])
    model = model_of(bundle)
    facts = {entry.key: entry.value for entry in model.metadata_props}
    assert facts["bundle_sha256"] == bundle.digest
    assert facts["scene"] == "random_bundle"
    assert facts["channels"] == "B,G,R"
    assert float(facts["depth_mm_per_unit"]) == bundle.pipeline.depth_mm_per_unit
    assert facts["force_axes"] == "z"
    assert '"force_n": "force, N"' in facts["units"]
    types = {value.name: value.type.tensor_type.elem_type for value in model.graph.output}
    assert types["force_raw"] == types["depth_words"] == 7  # int64
    assert model.SerializeToString(deterministic=True) == model_of(bundle).SerializeToString(
        deterministic=True
    )


@pytest.mark.parametrize(("outputs", "named"), [((XYZ,), "force.dots"), ((XYZ, "slip"), "the output slip")])
def test_dots_are_refused(tmp_path, outputs, named):
    scene = random_bundle.scene(outputs, dots=True, kernel="collapsed", clamp=False, size=32)
    bundle = random_bundle.random_bundle(tmp_path / "b", scene)
    with pytest.raises(ExportError, match=f"scene random_bundle: {named}.*there is no ONNX") as caught:
        model_of(bundle)
    assert "\n" not in str(caught.value)


def test_a_bundle_without_float_models_has_none_in_onnx(tmp_path):
    bundle = random_bundle.random_bundle(tmp_path / "b", SCENES["normals"])
    with pytest.raises(ExportError, match="has no float models"):
        model_of(bundle, arithmetic="both")


@pytest.mark.parametrize("window_px", smoothing.WINDOWS_PX)
@pytest.mark.parametrize("shape", [(6, 11, 3), (3, 2, 4)])
def test_smoothing_of_extreme_differences(window_px, shape):
    """Sums at their bounds, and small ones of both signs, whose means often end in a half; the smaller image
    lies inside the larger windows."""
    rng = np.random.default_rng(1)
    differences = np.concatenate(
        [
            rng.integers(-255, 256, (4, *shape)),
            rng.integers(-1, 2, (4, *shape)),
            np.full((1, *shape), 255),
            np.full((1, *shape), -255),
        ]
    ).astype(np.int32)
    graph = Graph()
    given = graph.input("x", np.int32, differences.shape)
    graph.output(smoothed(graph, given, window_px, shape), "y", np.int64, differences.shape)
    (found,) = run(graph, x=differences)
    np.testing.assert_array_equal(found, smoothing.smoothed(differences, window_px))


def test_slopes_of_every_kind_of_normal():
    """n_z above, at and below zero; n_x and n_y zero, small, and so large that the slope saturates."""
    across = np.array([-70_000, -300, -1, 0, 1, 2, 299, 70_000])
    x, y, z = np.meshgrid(across, across, np.array([-70_000, -1, 0, 1, 3, 500, 70_000]), indexing="ij")
    normals = np.stack([x, y, z], axis=-1).reshape(1, 8, -1, 3)
    ratio = GradientRatio(normal_width=18, width=17, fraction=14)
    graph = Graph()
    slopes, saturated = slopes_of(graph, ratio, graph.input("x", np.int64, normals.shape))
    for value, name in ((slopes, "slopes"), (saturated, "saturated")):
        graph.output(value, name, np.int64, (*normals.shape[:3], 2))
    for found, expected in zip(run(graph, x=normals), ratio(normals), strict=True):
        np.testing.assert_array_equal(found, expected)


def run(graph: Graph, **given):
    """A graph's outputs under onnxruntime."""
    model = helper.make_model(graph.proto("t"), opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    return onnx_check.session_of(model, threads=1).run(None, given)


@pytest.mark.parametrize("rounding", [NEAREST, FLOOR])
@pytest.mark.parametrize("shift", [0, 1, 17, 40])
def test_round_shift_at_its_bound(rounding, shift):
    bound = (1 << 45) + 12345
    words = np.array([-bound, -bound + 1, -1, 0, 1, 1 << 16, -(1 << 39), bound - 1, bound])
    graph = Graph()
    given = graph.input("x", np.int64, ("n",))
    graph.output(graph.round_shift(given, shift, rounding, bound), "y", np.int64, ("n",))
    (found,) = run(graph, x=words)
    np.testing.assert_array_equal(found, round_shift(words, shift, rounding))


def test_words_that_int64_might_not_hold():
    with pytest.raises(ValueError, match=r"word bound .* ONNX's int64"):
        Graph().round_shift("x", 3, NEAREST, 1 << 61)
