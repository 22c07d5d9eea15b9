"""What the steps of a training write; that they run and resume is tested in test_build.py."""

import numpy as np
import pytest

from fastac.flow import training
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.hyperforce import collapse
from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import assemble, quantise
from fastac.store.files import load_arrays, save_arrays


def test_rest_is_the_dataset_s_or_flat(tiny_data):
    np.testing.assert_allclose(training.rest_depth_mm(tiny_data), tiny_data.rest_depth_mm)
    assert training.rest_depth_mm(tiny_data).dtype == np.float64
    flat = type(tiny_data)(**{**vars(tiny_data), "rest_depth_mm": None})
    np.testing.assert_array_equal(training.rest_depth_mm(flat), np.zeros((16, 16)))


def test_arrays_survive_a_file_which_is_whole_or_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "x.npz"
    arrays = {"a.b": np.arange(5), "c": np.array(2.5, dtype=np.float32)}
    save_arrays(path, arrays)

    def full(file, **_):
        file.write(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OSError, match="no space left"):
        save_arrays(path, {"a.b": np.zeros(1)})
    found = load_arrays(path)
    assert set(found) == set(arrays)
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def test_pickles_are_not_opened(tmp_path):
    np.savez(tmp_path / "x.npz", bomb=np.array([None]))
    with pytest.raises(ValueError, match="Object arrays cannot be loaded"):
        load_arrays(tmp_path / "x.npz")


def test_learning_curves_become_arrays():
    history = [{"epoch": 1, "train_loss": 0.5}, {"epoch": 2, "train_loss": 0.25}]
    found = training.curve(history, "normals")
    assert set(found) == {"history.normals.epoch", "history.normals.train_loss"}
    np.testing.assert_array_equal(found["history.normals.train_loss"], [0.5, 0.25])
    assert training.curve([], "normals") == {}


def test_network_arrays_are_copies():
    network = PixelNetwork(5, hidden=(4,))
    arrays = training.network_arrays(network)
    assert {k: v.shape for k, v in arrays.items()} == {
        "network.0.weight": (4, 5),
        "network.0.bias": (4,),
        "network.1.weight": (3, 4),
        "network.1.bias": (3,),
    }
    arrays["network.0.bias"][:] = 9
    assert not (network.linear_layers[0].bias == 9).any()


def test_every_step_s_result_is_in_the_bundle(tiny_folder, tiny_bundle, tiny_data):
    """Layers, kernels, float weights and learning curves, unchanged."""
    weights = load_arrays(tiny_folder / "normals.npz")
    integers = load_arrays(tiny_folder / "integers.npz")
    force = load_arrays(tiny_folder / "force.npz")
    layers = quantise.layers_from_arrays(integers)
    for a, b in zip(layers, tiny_bundle.pipeline.layers, strict=True):
        np.testing.assert_array_equal(a.weight, b.weight)
        np.testing.assert_array_equal(a.bias, b.bias)
    curves = {k: v for k, v in integers.items() if k.startswith("history.finetune.")}
    assert len(curves["history.finetune.epoch"]) == 3
    # Kernels are trained once, and fitted from there to each pipeline's displacements.
    assert len(force["history.force.epoch"]) == 5
    for name in ("float", "integer"):
        assert len(force[f"history.force_{name}.regularisation"]) > 5
    assert (force["force.float_weights"] != force["force.integer_weights"]).any()
    expected = weights | curves | force
    assert set(tiny_bundle.floats) == set(expected)
    for name, array in expected.items():
        np.testing.assert_array_equal(tiny_bundle.floats[name], array)
    kernels, scale = assemble.quantise_weights(force["force.integer_weights"].astype(float), 8)
    np.testing.assert_array_equal(tiny_bundle.pipeline.force.kernel, kernels)
    unit = tiny_bundle.pipeline.displacement_mm_per_unit
    assert tiny_bundle.pipeline.force_n_per_unit == pytest.approx(unit / scale)
    np.testing.assert_array_equal(tiny_bundle.pipeline.background, tiny_data.background)


@pytest.mark.parametrize("arithmetic", ["float", "integer"])
def test_kernels_are_trained_on_what_their_own_pipeline_finds(tiny_bundle, tiny_data, arithmetic):
    """Their validation error, computed again from frames, is the best of the learning curve.

    The integers' own kernels are rounded to 8 bits in the bundle; here they are not.
    """
    index = tiny_data.indices("validation")
    pipelines = {"float": FloatPipeline.from_bundle(tiny_bundle), "integer": Emulator(tiny_bundle.pipeline)}
    found = pipelines[arithmetic].run(tiny_data.frames[index]).displacement_mm
    weight = collapse(tiny_bundle.floats[f"force.{arithmetic}_weights"])[0]
    force = (np.maximum(found, 0) * weight).sum(axis=(1, 2))
    error = np.abs(force - tiny_data.force_n[index, 2]).mean()
    curve = tiny_bundle.floats[f"history.force_{arithmetic}.validation_mae_n"]
    assert error <= curve.min() * 1.001
    if arithmetic == "float":
        assert error == pytest.approx(curve.min(), rel=1e-3)
