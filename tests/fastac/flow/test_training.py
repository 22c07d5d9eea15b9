# amaranth: UnusedElaboratable=no
"""What the steps of a training write; that they run and resume is tested in test_build.py."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fastac.flow import force_training, training
from fastac.flow.pipelines import integer_pipeline
from fastac.gateware.cycle_model import CycleModel
from fastac.gateware.datapath import Datapath
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.hyperforce import collapse
from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import assemble, quantise
from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.features import integer_features
from fastac.models.integer.force import terms
from fastac.models.training.pruning import digits
from fastac.models.training.pruning.hidden_neurons import widths
from fastac.models.training.whole_frames import force_features, force_least_squares
from fastac.models.vision.dots import follower_of, windows_of
from fastac.sensor.dataset import read
from fastac.sensor.groups import left_out_together
from fastac.store.files import load_arrays, save_arrays
from fastac.synth.estimates import resources


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


class Colours:
    """A pipeline whose slopes are the first two channels."""

    def __init__(self, scene):
        self.scene = scene

    def run(self, frames, **_):
        return SimpleNamespace(slopes=frames[..., :2].astype(float))


@pytest.mark.parametrize("labels", ["force", "geometry"])
def test_weights_are_fitted_to_frames_as_they_are(make_scene, tiny_data, labels):
    """Under the camera's light, also where training sees others."""
    keys = {"outputs": ["force_z"], "poisson": {"solver": "adjoint"}}
    keys["force"] = {"clamp": False, "fit": "slopes"}
    scene = make_scene(**keys, training={"labels": labels})
    samples = force_training.force_samples(Colours(scene), tiny_data, progress=False)
    assert set(samples.found) == {"train", "validation"}
    for split, found in samples.found.items():
        index = tiny_data.indices(split)
        frames = tiny_data.frames[index][..., :2].astype(float)
        np.testing.assert_array_equal(found, frames - tiny_data.background[..., :2])
        np.testing.assert_array_equal(samples.force_n[split], tiny_data.forces_n(index, scene.force_axes))


@pytest.mark.parametrize("known", [True, False])
def test_force_samples_say_which_frames_are_left_out_together(make_scene, tiny_data, known):
    names = np.array([f"recording {k % 3}" for k in range(len(tiny_data))])
    data = replace(tiny_data, group=names if known else None)
    scene = make_scene(
        outputs=["force_z"], poisson={"solver": "adjoint"}, force={"clamp": False, "fit": "slopes"}
    )
    recording = force_training.force_samples(Colours(scene), data, progress=False).recording
    every = left_out_together(data)
    assert len(np.unique(every[data.split != "test"])) == (3 if known else 5)
    for split in ("train", "validation"):
        np.testing.assert_array_equal(recording[split], every[data.indices(split)])


def test_pickles_are_not_opened(tmp_path):
    np.savez(tmp_path / "x.npz", bomb=np.array([None]))
    with pytest.raises(ValueError, match="Object arrays cannot be loaded"):
        load_arrays(tmp_path / "x.npz")


def test_few_bits_cost_less_where_training_felt_their_rounding(tiny_data, make_scene, tmp_path):
    """Normals of the quantised network on test frames, before it is fine-tuned, at 3 bits of activations."""
    errors = {}
    for felt in (False, True):
        scene = make_scene(
            numbers={"activation_bits": 3}, training={"normals_epochs": 60, "rounding_noise": felt}
        )
        training.normals(tiny_data, scene, tmp_path / "normals.npz", progress=False)
        network = PixelNetwork.from_arrays(load_arrays(tmp_path / "normals.npz"))
        index = tiny_data.indices("test")
        x = integer_features(tiny_data.frames[index], tiny_data.background).reshape(-1, 6)
        words = x.astype(np.int64)
        for layer in training.quantised(network, x, scene):
            words = layer(words)
        found = words / np.linalg.norm(words, axis=1, keepdims=True)
        errors[felt] = np.abs(found - tiny_data.normals[index].reshape(-1, 3)).mean()
    assert errors[True] < 0.9 * errors[False]


def test_network_and_integers_learn_from_smoothed_differences(tiny_data, make_scene, tmp_path):
    """They are best on frames that are smoothed as in training."""
    scene = make_scene(outputs=["normals"], network={"smoothing_px": 2})
    paths = [tmp_path / name for name in ("normals.npz", "integers.npz")]
    training.normals(tiny_data, scene, paths[0], progress=False)
    training.integers(tiny_data, scene, *paths, progress=False)
    arrays = [load_arrays(path) for path in paths]
    pipeline = training.assemble(tiny_data, scene, *arrays, {}, tmp_path / "bundle").pipeline
    index, errors = tiny_data.indices("test"), {}
    for window_px in (0, 2, 4, 8):
        network = scene.network.model_copy(update={"smoothing_px": window_px})
        other = pipeline.replace(scene=scene.model_copy(update={"network": network}))
        found = Emulator(other).run(tiny_data.frames[index]).normals
        errors[window_px] = np.abs(found - tiny_data.normals[index]).mean()
    assert min(errors, key=errors.get) == 2, errors


def test_learning_curves_become_arrays():
    history = [{"epoch": 1, "train_loss": 0.5}, {"epoch": 2, "train_loss": 0.25}]
    found = training.curve(history, "normals")
    assert set(found) == {"history.normals.epoch", "history.normals.train_loss"}
    np.testing.assert_array_equal(found["history.normals.train_loss"], [0.5, 0.25])
    assert training.curve([], "normals") == {}


@pytest.mark.parametrize("weights", ["loadable", "baked"])
def test_a_pruned_network_is_narrower_and_its_hardware_too(tiny_data, make_scene, tmp_path, weights):
    scene = make_scene(
        outputs=["depth"],
        network={"width": [9, 8, 10], "prune": 0.5},
        hardware={"weights": weights},
        training={"normals_epochs": 5, "normals_batch_px": 1024},
    )
    floats, integers = tmp_path / "normals.npz", tmp_path / "integers.npz"
    training.normals(tiny_data, scene, floats, progress=False)
    training.integers(tiny_data, scene, floats, integers, progress=False)
    pipeline = integer_pipeline(load_arrays(integers), tiny_data, scene)
    asked, kept = scene.network.hidden, pipeline.hidden
    assert asked == (9, 8, 10)
    assert all(few <= many for few, many in zip(kept, asked, strict=True))
    assert sum(kept) < sum(asked)
    path, model = Datapath(pipeline), CycleModel(scene, hidden=kept)
    assert path.mlp.latency == model.mlp.latency
    assert path.mlp.multipliers == model.mlp.multipliers
    assert resources.dsp_slices(pipeline) == path.multipliers
    many = np.concatenate([layer.requantisation.multiplier for layer in pipeline.layers[:-1]])
    few_digits = digits.digit_counts(many).max() <= max(digits.MULTIPLIER_DIGITS)
    assert few_digits == (weights == "baked")


@pytest.mark.parametrize("weights", ["loadable", "baked"])
def test_a_network_pruned_to_a_width_has_it_whatever_its_neurons_say(
    tiny_data, make_scene, tmp_path, monkeypatch, weights
):
    """`prune` then concerns the digits of baked weights alone."""
    scene = make_scene(
        outputs=["depth"],
        network={"width": [6, 5, 5], "train_width": 7, "prune": 0.5},
        hardware={"weights": weights},
        training={"normals_epochs": 3, "normals_batch_px": 1024},
    )
    quantised = quantise.compensated_layers

    def with_an_idle_neuron(weight, bias, *others, **named):
        weight[1][0], bias[1][0] = 0, -1
        return quantised(weight, bias, *others, **named)

    monkeypatch.setattr(quantise, "compensated_layers", with_an_idle_neuron)
    floats, integers = tmp_path / "normals.npz", tmp_path / "integers.npz"
    training.normals(tiny_data, scene, floats, progress=False)
    training.integers(tiny_data, scene, floats, integers, progress=False)
    layers = quantise.layers_from_arrays(load_arrays(integers))
    assert tuple(len(layer.weight) for layer in layers[:-1]) == (6, 5, 5) == scene.network.hidden
    many = np.concatenate([layer.requantisation.multiplier for layer in layers[:-1]])
    few_digits = digits.digit_counts(many).max() <= max(digits.MULTIPLIER_DIGITS)
    assert few_digits == (weights == "baked")


def test_least_squares_on_the_force_come_last(make_scene, dataset_of, tmp_path, monkeypatch):
    """Of as many neurons as the scene wants; the learning curve is kept."""
    scene = make_scene(
        name="more_presses",
        protocol={"train_grid": 5},
        outputs=["force_xyz"],
        poisson={"solver": "adjoint"},
        force={"fit": "slopes", "clamp": False},
        network={"width": [4, 4, 4], "train_width": 5},
        training={"normals_epochs": 2, "force_steps": 10},
    )
    monkeypatch.setattr(force_features, "SLOPES_SIZE", 2)
    seen, train = [], force_least_squares.train

    def watched(network, frames, **how):
        seen.append((widths(network), train(network, frames, **how), network.arrays))
        return seen[-1][1]

    monkeypatch.setattr(force_least_squares, "train", watched)
    data = read(dataset_of(scene), scene)
    training.normals(data, scene, tmp_path / "normals.npz", progress=False)
    found, ((width, history, arrays),) = load_arrays(tmp_path / "normals.npz"), seen
    assert width == (4, 4, 4)
    assert all(np.array_equal(found[name], values) for name, values in arrays.items())
    curve = found["history.force_alone.train_mae_n"]
    assert np.array_equal(curve, [entry["train_mae_n"] for entry in history])
    assert 2 <= len(curve) <= 11
    assert (np.diff(curve) < 0).any()


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
    """Their validation error, computed again from frames, is at most the best of the learning curve.

    The integers' own kernels are rounded to 8 bits in the bundle; here they are not.
    """
    index = tiny_data.indices("validation")
    pipelines = {"float": FloatPipeline.from_bundle(tiny_bundle), "integer": Emulator(tiny_bundle.pipeline)}
    found = pipelines[arithmetic].run(tiny_data.frames[index]).displacement_mm
    weight = collapse(tiny_bundle.floats[f"force.{arithmetic}_weights"])[0]
    force = (np.maximum(found, 0) * weight).sum(axis=(1, 2))
    error = np.abs(force - tiny_data.force_n[index, 2]).mean()
    curve = tiny_bundle.floats[f"history.force_{arithmetic}.validation_mae_n"]
    assert error <= 1.001 * curve.min()  # less: in the end these frames are fitted too


class TestDots:
    """A scene whose slopes are bridged under dots, and whose force is also from the dots' shifts."""

    def test_they_are_in_the_bundle_as_they_were_trained(self, dotted_folder, dotted_bundle, dotted_data):
        force, found = load_arrays(dotted_folder / "force.npz"), dotted_bundle.pipeline
        assert force["force.integer_weights"].shape == (1, 30, 30, 4)
        assert force["force.integer_dot_weights"].shape == force["force.float_dot_weights"].shape == (1, 9, 2)
        for name, array in force.items():
            np.testing.assert_array_equal(dotted_bundle.floats[name], array)
        follower = follower_of(dotted_data.background, found.scene.sensor)
        np.testing.assert_array_equal(found.follower.rest, follower.rest)
        rest_px = force["dots.rest_px"]
        assert np.linalg.norm(rest_px - follower.rest * 2.0**-FRACTION, axis=-1).max() < 0.2
        word_n = found.force_n_per_unit * 2.0 ** (FRACTION + found.dot_force.exponent)
        stood_for = found.dot_force.weighted.weight[:, :, 0] * word_n[:, None, None]
        np.testing.assert_allclose(stood_for, force["force.integer_dot_weights"], atol=word_n.max() / 2)
        assert found.validity.dots == 9
        np.testing.assert_array_equal(
            found.bridge.windows.threshold, windows_of(dotted_data.background, found.scene.sensor).threshold
        )

    @pytest.mark.parametrize("arithmetic", ["float", "integer"])
    def test_weights_are_fitted_to_what_their_own_pipeline_finds(
        self, dotted_bundle, dotted_data, arithmetic
    ):
        """Their validation error, computed again from frames, is at most the best of the learning curve."""
        index, floats = dotted_data.indices("validation"), dotted_bundle.floats
        pipelines = {
            "float": FloatPipeline.from_bundle(dotted_bundle),
            "integer": Emulator(dotted_bundle.pipeline),
        }
        found = pipelines[arithmetic].run(dotted_data.frames[index])
        x = terms(found.displacement_mm, dotted_bundle.scene.force.bends_mm)
        force = np.einsum("fijt,aijt->fa", x, floats[f"force.{arithmetic}_weights"])
        force += np.einsum("fmk,amk->fa", found.dot_shifts_px, floats[f"force.{arithmetic}_dot_weights"])
        error = np.abs(force - dotted_data.forces_n(index, (2,))).sum(axis=1).mean()
        curve = floats[f"history.force_{arithmetic}.validation_mae_n"]
        assert error <= 1.001 * curve.min()  # less: in the end these frames are fitted too
        if arithmetic == "float":
            np.testing.assert_allclose(found.force_n, force, atol=1e-5 * np.abs(force).max())

    def test_normals_are_trained_on_skin_alone(self, dotted_bundle, dotted_data):
        skin = training.skin_alone(dotted_data, dotted_bundle.scene)
        dark = dotted_bundle.pipeline.bridge.dark(dotted_data.frames)
        known = np.ones_like(dark) if dotted_data.valid is None else dotted_data.valid
        np.testing.assert_array_equal(skin.valid, known & ~dark)
        assert dark.any(axis=(1, 2)).all()

    def test_without_them_a_dataset_stays_as_it_is(self, tiny_data, tiny_scene):
        assert training.skin_alone(tiny_data, tiny_scene) is tiny_data
