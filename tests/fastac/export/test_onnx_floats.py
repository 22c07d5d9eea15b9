"""The float models as ONNX under onnxruntime, within the rounding of float32 of the float pipeline."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

from fastac.export import onnx_check
from fastac.export.onnx_file import ExportError, model_of
from fastac.models import random_bundle
from fastac.models.floating.pipeline import FloatPipeline

LARGEST = {
    "normals": 2e-6,
    "slopes": 5e-6,
    "displacement_mm": 2e-5,
    "depth_mm": 2e-5,
    "force_n": 2e-5,
    "force_map_n": 2e-5,
}
"""The most that outputs may differ, in their units; tens of units in the last place of float32."""


def with_floats(folder, scene):
    """A random bundle with random float models beside its integers."""
    bundle = random_bundle.random_bundle(folder, scene)
    rng, arrays = np.random.default_rng(3), {}
    for k, layer in enumerate(bundle.pipeline.layers):
        neurons, inputs = layer.weight.shape
        arrays[f"network.{k}.weight"] = (rng.normal(size=(neurons, inputs)) / np.sqrt(inputs)).astype(
            np.float32
        )
        arrays[f"network.{k}.bias"] = (0.1 * rng.normal(size=neurons)).astype(np.float32)
    arrays[f"network.{k}.weight"][2] *= 0.2
    arrays[f"network.{k}.bias"][2] = 1.5
    if scene.wants_force:
        (weights,) = random_bundle.force_weights(scene, rng, None)
        arrays["force.float_weights"] = weights.astype(np.float32) / 100
    return replace(bundle, floats=arrays)


SCENES = {
    "dst2d": random_bundle.scene(("normals", "depth", "force_z")),
    "backward, no clamp": random_bundle.scene(("force_xyz",), divergence="backward", clamp=False),
    "difference": random_bundle.scene(("depth",), mode="difference"),
    "force map": random_bundle.scene(("depth", "force_z", "force_map")),
    "weights with bends": random_bundle.scene(
        ("force_xyz",), kernel="collapsed", clamp=False, band_mm=0.001, deep_mm=(0.004, 0.006)
    ),
    "adjoint": random_bundle.scene(("force_xyz",), solver="adjoint", kernel="collapsed"),
    "slopes beside depth": random_bundle.scene(("depth", "force_xyz"), source="slopes"),
    "bridged": random_bundle.scene(("depth",), bridge_dots=True),
    "smoothed over 4 px": random_bundle.scene(("depth", "force_z"), smoothing_px=4),
    "smoothed over 8 px": random_bundle.scene(("normals",), channels="bgr+nir", lanes=2, smoothing_px=8),
}


def check(bundle) -> dict[str, float]:
    """The largest differences, all of them small; frames reach the slopes' limits."""
    frames = onnx_check.extreme_frames(bundle.pipeline.background)
    session = onnx_check.session_of(model_of(bundle, arithmetic="float"), threads=1)
    known = FloatPipeline.from_bundle(bundle).run(frames)
    found = onnx_check.run(session, frames, bundle.pipeline.background)
    assert found.keys() == {name for name in LARGEST if getattr(known, name) is not None}
    for name, values in found.items():
        expected = getattr(known, name)
        assert (values.shape, values.dtype) == (expected.shape, expected.dtype), name
        np.testing.assert_allclose(values, expected, rtol=1e-5, atol=LARGEST[name], err_msg=name)
    return onnx_check.compare(bundle, session, "float", frames).largest


@pytest.mark.parametrize("name", SCENES)
def test_every_output_is_close(name, tmp_path):
    largest = check(with_floats(tmp_path / "b", SCENES[name]))
    assert all(value >= 0 for value in largest.values())


def test_trained_models_and_integers_in_one_file(tiny_bundle):
    frames = onnx_check.extreme_frames(tiny_bundle.pipeline.background)
    session = onnx_check.session_of(model_of(tiny_bundle, arithmetic="both"), threads=1)
    found = onnx_check.compare(tiny_bundle, session, "both", frames)
    assert found.different == 0
    assert found.values > 10_000
    assert found.largest.keys() == {
        f"float_{name}" for name in ("normals", "slopes", "displacement_mm", "depth_mm", "force_n")
    }
    assert found.largest["float_depth_mm"] < LARGEST["depth_mm"]
    check(tiny_bundle)


def test_a_bridge_ties_floats_to_the_known_background(tmp_path):
    bundle = with_floats(tmp_path / "b", SCENES["bridged"])
    with pytest.raises(ExportError, match=r"network\.bridge_dots: .*--background-input"):
        model_of(bundle, arithmetic="both", background_input=True)
    model_of(bundle, arithmetic="integer", background_input=True)


def test_the_background_as_an_input(tmp_path):
    bundle = with_floats(tmp_path / "b", SCENES["dst2d"])
    other = np.clip(bundle.pipeline.background.astype(int) - 9, 0, 255).astype(np.uint8)
    frames = onnx_check.extreme_frames(bundle.pipeline.background)
    model = model_of(bundle, arithmetic="float", background_input=True)
    found = onnx_check.run(onnx_check.session_of(model, threads=1), frames, other)
    known = replace(FloatPipeline.from_bundle(bundle), background=other).run(frames)
    np.testing.assert_allclose(found["depth_mm"], known.depth_mm, rtol=1e-5, atol=LARGEST["depth_mm"])
    assert np.abs(found["depth_mm"] - FloatPipeline.from_bundle(bundle).run(frames).depth_mm).max() > 1e-3
