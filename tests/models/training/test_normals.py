from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.floating.network import predict
from fastac.models.integer.features import integer_features
from fastac.models.training.normals import Fit, normal_loss, train
from fastac.models.training.pruning.hidden_neurons import outputs


def loss_of(normals: np.ndarray, truth: np.ndarray) -> float:
    """The paper's loss in NumPy, from predicted normals of any length and true unit normals."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    return float(np.abs(unit - truth).sum(axis=-1).mean())


def pixels(data, split: str) -> tuple[np.ndarray, np.ndarray]:
    index = data.indices(split)
    x = integer_features(data.frames[index], data.background)
    return x.reshape(-1, x.shape[-1]), data.normals[index].reshape(-1, 3).astype(float)


def tilted(degrees) -> torch.Tensor:
    angle = torch.deg2rad(torch.as_tensor(degrees, dtype=torch.float64))
    return torch.stack([torch.sin(angle), torch.zeros_like(angle), torch.cos(angle)], dim=-1)


class TestLoss:
    def test_is_the_paper_s(self):
        rng = np.random.default_rng(0)
        found, truth = rng.normal(size=(2, 50, 3))
        truth /= np.linalg.norm(truth, axis=-1, keepdims=True)
        loss = normal_loss(torch.tensor(found), torch.tensor(truth))
        assert loss.item() == pytest.approx(loss_of(found, truth), rel=1e-12)

    def test_small_errors_count_by_their_squares_and_large_ones_by_themselves(self):
        small, large = tilted([0.1]), tilted([90.0])
        truth = tilted([0.0])
        error = np.sin(np.deg2rad(0.1))
        assert normal_loss(small, truth, 0.2).item() == pytest.approx(error**2 / 0.4, rel=1e-3)
        assert normal_loss(large, truth, 1e-4).item() == pytest.approx(2, rel=1e-3)
        assert normal_loss(large, truth, 1e-9).item() == pytest.approx(normal_loss(large, truth).item())

    def test_of_equal_normals_is_nothing(self):
        assert normal_loss(tilted([30.0]), tilted([30.0]), 0.1).item() == pytest.approx(0, abs=1e-12)

    @pytest.mark.parametrize(("huber_delta", "degrees"), [(0.0, 0.0), (1.0, 2.0)])
    def test_what_noise_hides_is_found_in_the_mean(self, huber_delta, degrees):
        """A quarter of the labels is tilted by 8°, and no feature says which: the smallest absolute error is
        that of no tilt, the smallest squared one that of the mean tilt."""
        y = tilted([0.0, 0.0, 0.0, 8.0] * 64).numpy().astype(np.float32)
        model = torch.nn.Linear(1, 3)
        torch.nn.init.constant_(model.bias, 1)  # any normal that faces the camera
        fit = Fit(epochs=60, batch=64, rate=0.05, seed=1, label="test", huber_delta=huber_delta)
        fit(model, np.zeros((len(y), 1)), y)
        found = model.bias.detach().numpy()
        assert np.rad2deg(np.arctan2(found[0], found[2])) == pytest.approx(degrees, abs=0.1)


class TestTrain:
    def test_lowers_the_loss_and_keeps_the_best_epoch(self, tiny_data, tiny_scene):
        network, history = train(tiny_data, tiny_scene.training)
        assert [entry["epoch"] for entry in history] == list(range(1, 16))
        assert history[-1]["train_loss"] < 0.25 * history[0]["train_loss"]
        # What it returns is the network of the best epoch, and better than calling everything flat.
        x, y = pixels(tiny_data, "validation")
        found = loss_of(predict(network, x), y)
        assert found == pytest.approx(min(entry["validation_loss"] for entry in history), rel=1e-4)
        assert found < 0.3 * loss_of(np.tile([0.0, 0, 1], (len(y), 1)), y)

    def test_the_best_epoch_need_not_be_the_last(self, tiny_data, make_scene):
        """Trained on mirrored normals, the validation error on the true ones grows."""
        mirrored = tiny_data.normals * np.float32([-1, -1, 1])
        training = (tiny_data.split == "train")[:, None, None, None]
        data = replace(tiny_data, normals=np.where(training, mirrored, tiny_data.normals))
        network, history = train(data, make_scene(training={"normals_epochs": 5}).training)
        losses = [entry["validation_loss"] for entry in history]
        assert losses[-1] > 1.2 * min(losses)
        x, y = pixels(tiny_data, "validation")
        assert loss_of(predict(network, x), y) <= min(losses) * 1.0001

    def test_stops_when_patience_ends(self, tiny_data, make_scene):
        """Trained on mirrored normals, the second epoch is worse than the first, and so is the third."""
        mirrored = tiny_data.normals * np.float32([-1, -1, 1])
        training = (tiny_data.split == "train")[:, None, None, None]
        data = replace(tiny_data, normals=np.where(training, mirrored, tiny_data.normals))
        lengths = [
            len(train(data, make_scene(training={"normals_epochs": 9, "patience_epochs": count}).training)[1])
            for count in (2, 4)
        ]
        assert lengths[0] + 2 == lengths[1] < 9

    def test_teachers_replace_the_labels(self, tiny_data, make_scene):
        """With teachers trained on mirrored labels, the network learns mirrored normals: it follows the
        teachers."""
        teach = {"teachers": 2, "teacher_width": 8, "teacher_epochs": 25, "normals_epochs": 15}
        mirrored = replace(tiny_data, normals=tiny_data.normals * np.float32([-1, -1, 1]))
        network, _ = train(mirrored, make_scene(training=teach).training)
        x, y = pixels(tiny_data, "test")
        mirror = y * [-1, -1, 1]
        assert loss_of(predict(network, x), mirror) < 0.4 * loss_of(predict(network, x), y)
        # What it learns is not what labels alone would teach.
        alone, _ = train(mirrored, make_scene(training={**teach, "teachers": 0}).training)
        assert np.abs(predict(network, x) - predict(alone, x)).max() > 1e-3

    def test_noise_on_the_position_hides_the_position(self, tiny_data, make_scene):
        """Labels that depend on position alone are learned less well with more noise on the position."""
        losses = []
        for noise in (0.0, 0.3, 0.9):
            settings = make_scene(training={"position_noise": noise, "normals_epochs": 8}).training
            _, history = train(tiny_data, settings)
            losses.append(history[-1]["train_loss"])
        assert losses[0] < losses[1] < losses[2]

    def test_the_seed_decides_everything(self, tiny_data, make_scene):
        def weights(**changes):
            settings = make_scene(training={"normals_epochs": 1, "input_noise": 0.1, **changes}).training
            return train(tiny_data, settings)[0].linear_layers[0].weight.detach().numpy()

        torch.manual_seed(99)  # what others drew before must not matter
        first = weights()
        torch.manual_seed(7)
        np.testing.assert_array_equal(first, weights())
        assert (first != weights(seed=2)).any()
        assert (first != weights(input_noise=0.0)).any()

    def test_works_without_a_validation_split(self, tiny_data, make_scene):
        split = np.where(tiny_data.split == "validation", "train", tiny_data.split)
        settings = make_scene(training={"normals_epochs": 2}).training
        _, history = train(replace(tiny_data, split=split), settings)
        assert set(history[0]) == {"epoch", "train_loss"}

    def test_leaves_torch_s_threads_alone(self, tiny_data, make_scene):
        before = torch.get_num_threads()
        try:
            torch.set_num_threads(3)
            train(tiny_data, make_scene(training={"normals_epochs": 1}).training)
            assert torch.get_num_threads() == 3
        finally:
            torch.set_num_threads(before)


def test_the_width_of_the_hidden_layers(tiny_data, make_scene):
    network, _ = train(tiny_data, make_scene(training={"normals_epochs": 1}).training, (5, 6, 7))
    assert [len(layer.weight) for layer in network.linear_layers] == [5, 6, 7, 3]


def test_active_initial_weights_leave_no_neuron_dead(tiny_data, make_scene):
    def dead(**training) -> int:
        settings = make_scene(training={"normals_epochs": 1, **training}).training
        network, _ = train(tiny_data, settings)
        x, _ = pixels(tiny_data, "train")
        return sum(int((layer == 0).all(axis=0).sum()) for layer in outputs(network, x))

    assert dead(initial_weights="active") < dead()
