from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.floating.network import predict
from fastac.models.integer.features import integer_features, scales
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.integer.quantise import quantise_layers
from fastac.models.training.bit_true import BitTrueNetwork, finetune
from fastac.models.training.labelled_pixels import labelled_pixels, labelled_splits
from fastac.models.training.normals import train


def loss_of(normals: np.ndarray, truth: np.ndarray) -> float:
    """The paper's loss in NumPy, from predicted normals of any length and true unit normals."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    return float(np.abs(unit - truth).sum(axis=-1).mean())


def pixels(data, split: str) -> tuple[np.ndarray, np.ndarray]:
    index = data.indices(split)
    x = integer_features(data.frames[index], data.background)
    return x.reshape(-1, x.shape[-1]), data.normals[index].reshape(-1, 3).astype(float)


def random_layers(
    seed: int, *, weight_bits: int = 8, activation_bits: int = 7, last_weight_bits: int = 12
) -> tuple[Layer, ...]:
    rng = np.random.default_rng(seed)
    layers, limit = [], np.array([255] * 4 + [127] * 2)
    top = (1 << (weight_bits - 1)) - 1
    highest = (1 << activation_bits) - 1
    for _ in range(3):
        weight = rng.integers(-top, top + 1, (16, len(limit)))
        spread = top * np.sqrt((limit**2).sum()) / 3  # of an accumulator over random inputs
        # The largest multipliers bring it to the range of the activations: some saturate, most vary.
        shift = 17 + int(np.log2(spread / highest))
        scale = Requantisation(rng.integers(1 << 14, 1 << 17, 16), shift, activation_bits)
        bias = rng.integers(-int(spread), int(spread), 16)
        layers.append(Layer(weight, bias, limit, weight_bits, scale))
        limit = np.full(16, highest)
    top = (1 << (last_weight_bits - 1)) - 1
    weight = rng.integers(-top, top + 1, (3, 16))
    weight[2] = top  # nothing cancels: the longest words there are
    return (*layers, Layer(weight, rng.integers(-100_000, 100_000, 3), limit, last_weight_bits))


def by_integers(layers, x: np.ndarray) -> np.ndarray:
    for layer in layers:
        x = layer(x)
    return x


def random_features(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    extremes = np.array([[255] * 4 + [127] * 2, [-255] * 4 + [-127] * 2, [0] * 6])
    body = np.column_stack([rng.integers(-255, 256, (3000, 4)), rng.integers(-127, 128, (3000, 2))])
    return np.vstack([extremes, body])


class TestBitTrueNetwork:
    @pytest.mark.parametrize(
        ("weight_bits", "activation_bits", "last_weight_bits"),
        [(8, 7, 12), (3, 3, 3), (8, 10, 12), (8, 7, 16), (8, 10, 16)],
    )
    @pytest.mark.parametrize("moved", [False, True])
    def test_forward_equals_the_integer_layers_exactly(
        self, weight_bits, activation_bits, last_weight_bits, moved
    ):
        layers = random_layers(
            1, weight_bits=weight_bits, activation_bits=activation_bits, last_weight_bits=last_weight_bits
        )
        network = BitTrueNetwork(layers)
        if moved:  # as training does: to where nothing is whole, and past the ends of the words
            generator = torch.Generator().manual_seed(1)
            with torch.no_grad():
                for parameter in network.parameters():
                    parameter += torch.randn(parameter.shape, generator=generator)
                network.weights[0][0] = 500
                network.multipliers[1][0] = 5000
                network.multipliers[1][1] = -5000
        x = random_features(2)
        found = network(torch.from_numpy(x.astype(np.float32))).detach().numpy()
        expected = by_integers(network.quantised(), x)
        np.testing.assert_array_equal(found.astype(np.int64), expected)
        assert len(np.unique(expected)) > 100

    def test_untouched_it_gives_back_the_layers(self):
        layers = random_layers(3)
        for a, b in zip(layers, BitTrueNetwork(layers).quantised(), strict=True):
            np.testing.assert_array_equal(a.weight, b.weight)
            np.testing.assert_array_equal(a.bias, b.bias)
            np.testing.assert_array_equal(a.input_limit, b.input_limit)
            assert a.weight_bits == b.weight_bits
            if a.requantisation is not None:
                np.testing.assert_array_equal(a.requantisation.multiplier, b.requantisation.multiplier)
                assert a.requantisation.shift == b.requantisation.shift

    def test_what_it_learns_can_be_loaded(self):
        network = BitTrueNetwork(random_layers(6))
        with torch.no_grad():
            for sign, k in ((1, 0), (-1, 1)):
                network.weights[k][0], network.biases[k][0] = sign * 1e4, sign * 1e9
        for layer in network.quantised():
            replace(layer, loadable=True)  # refuses what hardware for any weights could not hold
        for sign, layer in zip((1, -1), network.quantised(), strict=False):
            assert layer.weight[0].tolist() == [sign * layer.weight_limit] * layer.weight.shape[1]
            assert layer.bias[0] == sign * layer.bias_limit

    def test_inputs_with_noise_are_rounded_as_a_camera_would(self):
        network = BitTrueNetwork(random_layers(4))
        x = torch.from_numpy(random_features(4).astype(np.float32))
        torch.testing.assert_close(network(x + 0.3), network(x), rtol=0, atol=0)

    def test_gradients_pass_through_the_roundings(self):
        network = BitTrueNetwork(random_layers(5))
        x = torch.from_numpy(random_features(5).astype(np.float32))
        network(x).abs().mean().backward()
        for name, parameter in network.named_parameters():
            assert parameter.grad.abs().max() > 0, name

    def test_the_gradient_is_that_of_the_unrounded_layer(self):
        """Straight-through gradient of one neuron in its linear range: multiplier · 2**−shift · x."""
        scale = Requantisation(np.array([1 << 16]), 18)
        one = np.array([1])
        layers = (
            Layer(np.array([[3]]), np.array([0]), np.array([255]), 8, scale),
            Layer(np.array([[1]]), np.array([0]), 127 * one, 8),
        )
        network = BitTrueNetwork(layers)
        network(torch.tensor([[101.0]])).sum().backward()
        assert network.weights[0].grad.item() == pytest.approx(101 / 4)
        assert network.biases[0].grad.item() == pytest.approx(BitTrueNetwork.BIAS_UNIT / 4)
        assert network.weights[1].grad.item() == 303 // 4


class TestFinetune:
    @staticmethod
    def quantised(data, settings, **bits):
        """A trained float network and its layers after post-training quantisation."""
        network, _ = train(data, settings)
        x, _ = labelled_pixels(data, "train")
        arrays = [
            [getattr(layer, name).detach().numpy() for layer in network.linear_layers]
            for name in ("weight", "bias")
        ]
        words = {"weight_bits": 8, "activation_bits": 7, "last_weight_bits": 12, **bits}
        return network, quantise_layers(*arrays, scales(4), x, **words)

    def test_repairs_what_few_bits_broke(self, tiny_data, make_scene):
        learn = {"finetune_epochs": 15, "finetune_weights": True, "finetune_learning_rate": 0.05}
        settings = make_scene(training=learn).training
        network, before = self.quantised(tiny_data, settings, weight_bits=3)
        after, history = finetune(labelled_splits(tiny_data, settings), before, network, settings)
        x, y = pixels(tiny_data, "validation")
        found = loss_of(by_integers(after, x), y)
        assert found < 0.8 * loss_of(by_integers(before, x), y)
        assert found == pytest.approx(min(entry["validation_loss"] for entry in history), rel=1e-4)
        assert max(np.abs(layer.weight).max() for layer in after[:-1]) <= 3

    def test_never_makes_it_worse(self, tiny_data, make_scene):
        """With a learning rate of thousands of units fine-tuning only gets worse; the initial layers are
        kept."""
        wild = {"finetune_epochs": 2, "finetune_weights": True, "finetune_learning_rate": 3000.0}
        settings = make_scene(training=wild).training
        network, before = self.quantised(tiny_data, settings)
        after, history = finetune(labelled_splits(tiny_data, settings), before, network, settings)
        x, y = pixels(tiny_data, "validation")
        loss = loss_of(by_integers(before, x), y)
        assert min(entry["validation_loss"] for entry in history) > loss
        assert loss_of(by_integers(after, x), y) == pytest.approx(loss, rel=1e-9)

    @pytest.mark.parametrize("weights", [False, True])
    def test_hidden_weights_move_only_if_they_may(self, tiny_data, make_scene, weights):
        tune = {"finetune_epochs": 2, "finetune_weights": weights, "finetune_learning_rate": 0.5}
        settings = make_scene(training=tune).training
        network, before = self.quantised(tiny_data, settings, weight_bits=5, last_weight_bits=8)
        split = np.where(tiny_data.split == "validation", "train", tiny_data.split)
        pixels = labelled_splits(replace(tiny_data, split=split), settings)
        after, _ = finetune(pixels, before, network, settings)  # keeps the last epoch
        moved = [(a.weight != b.weight).any() for a, b in zip(before, after, strict=True)]
        assert moved == [weights] * 3 + [True]
        for a, b in zip(before[:-1], after[:-1], strict=True):
            assert (a.bias != b.bias).any()

    def test_no_epochs_change_nothing(self, tiny_data, make_scene):
        settings = make_scene(training={"normals_epochs": 1, "finetune_epochs": 0}).training
        network, layers = self.quantised(tiny_data, settings)
        after, history = finetune(labelled_splits(tiny_data, settings), layers, network, settings)
        assert after is layers
        assert history == []

    def test_integers_are_about_as_good_as_the_float_network(self, tiny_data, tiny_scene):
        network, before = self.quantised(tiny_data, tiny_scene.training)
        layers, _ = finetune(
            labelled_splits(tiny_data, tiny_scene.training), before, network, tiny_scene.training
        )
        x, y = pixels(tiny_data, "test")
        assert loss_of(by_integers(layers, x), y) < 1.05 * loss_of(predict(network, x), y)

    def test_the_float_network_is_what_is_learned(self, tiny_data, make_scene):
        """The train split's labels, here mirrored, have no effect: the teacher's normals are the targets."""
        settings = make_scene(training={"finetune_epochs": 1}).training
        network, layers = self.quantised(tiny_data, settings)
        mirrored = replace(tiny_data, normals=tiny_data.normals * np.float32([-1, -1, 1]))
        _, from_these = finetune(labelled_splits(mirrored, settings), layers, network, settings)
        _, from_those = finetune(labelled_splits(tiny_data, settings), layers, network, settings)
        assert from_these[0]["train_loss"] == from_those[0]["train_loss"]
        x, _ = pixels(tiny_data, "train")
        target = predict(network, x)
        target /= np.linalg.norm(target, axis=1, keepdims=True)
        before = loss_of(by_integers(layers, x), target)
        assert from_these[0]["train_loss"] == pytest.approx(before, rel=0.2)
