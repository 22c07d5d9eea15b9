from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.floating.network import predict
from fastac.models.integer.features import integer_features
from fastac.models.training.normals import labelled_pixels, train


def loss_of(normals: np.ndarray, truth: np.ndarray) -> float:
    """The paper's loss in NumPy, from predicted normals of any length and true unit normals."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    return float(np.abs(unit - truth).sum(axis=-1).mean())


def pixels(data, split: str) -> tuple[np.ndarray, np.ndarray]:
    index = data.indices(split)
    x = integer_features(data.frames[index], data.background)
    return x.reshape(-1, x.shape[-1]), data.normals[index].reshape(-1, 3).astype(float)


def with_background(data, split: str = "train"):
    """The dataset with the background added as a flat sample, as the importer of ball presses does."""
    flat = np.zeros((1, *data.normals.shape[1:]), np.float32)
    flat[..., 2] = 1
    return replace(
        data,
        frames=np.concatenate([data.frames, data.background[None]]),
        normals=np.concatenate([data.normals, flat]),
        split=np.append(data.split, split),
        depth_mm=None,
        force_n=None,
        indenter=None,
    )


class TestLabelledPixels:
    def test_are_all_pixels_of_the_split(self, tiny_data):
        x, y = labelled_pixels(tiny_data, "validation")
        expected_x, expected_y = pixels(tiny_data, "validation")
        np.testing.assert_array_equal(x, expected_x)
        np.testing.assert_allclose(y, expected_y, atol=1e-7)
        assert len(x) == 8 * 16 * 16

    def test_leave_out_what_is_not_valid(self, tiny_data):
        valid = np.random.default_rng(1).random(tiny_data.frames.shape[:3]) < 0.1
        normals = np.where(valid[..., None], tiny_data.normals, np.nan)
        x, y = labelled_pixels(replace(tiny_data, valid=valid, normals=normals), "train")
        index = tiny_data.indices("train")
        assert len(x) == valid[index].sum()
        assert np.isfinite(y).all()
        expected = integer_features(tiny_data.frames[index], tiny_data.background)[valid[index]]
        np.testing.assert_array_equal(x, expected)

    @pytest.mark.parametrize("fraction", [0.05, 0.2, 0.5])
    def test_flat_fraction_is_a_share_of_the_result(self, tiny_data, fraction):
        valid = np.ones((len(tiny_data) + 1, 16, 16), bool)
        valid[:-1, 2:] = False  # two rows of each contact: 18·32 pixels against 256 flat ones
        data = replace(with_background(tiny_data), valid=valid)
        x, y = labelled_pixels(data, "train", flat_fraction=fraction, seed=3)
        flat = (x[:, :4] == 0).all(axis=1) & (y == (0, 0, 1)).all(axis=1)
        if fraction < 0.3:
            assert flat.sum() / len(x) == pytest.approx(fraction, abs=0.003)
        else:
            assert flat.sum() == 256  # there are no more
        again, _ = labelled_pixels(data, "train", flat_fraction=fraction, seed=3)
        other, _ = labelled_pixels(data, "train", flat_fraction=fraction, seed=4)
        np.testing.assert_array_equal(x, again)
        assert fraction > 0.3 or (x != other).any()

    def test_zero_keeps_all_of_the_background(self, tiny_data):
        x, _ = labelled_pixels(with_background(tiny_data), "train")
        assert len(x) == 19 * 256

    def test_margins_and_the_skin_beyond_circles(self, tiny_data):
        data = with_background(tiny_data)
        count, circled = len(data), data.indices("train")[:-1]
        circles = {"center_px": np.full((count, 2), 7.5), "radius_px": np.full(count, 4.0)}
        circles["radius_px"][-1] = np.nan
        v, u = np.indices((16, 16))
        distance = np.hypot(u - 7.5, v - 7.5)
        data = replace(data, indenter=circles, valid=np.ones((count, 16, 16), bool))
        data.valid[:-1] &= distance <= 4
        x, y = labelled_pixels(data, "train", circle_margin=0.25, flat_beyond=2.0)
        inside, beyond = int((distance <= 3).sum()), int((distance > 8).sum())
        assert len(x) == len(circled) * (inside + beyond) + 256
        corners = x[-len(circled) * beyond :]
        assert (np.abs(corners[:, -2:]) > 20).any(axis=1).all()
        assert (y[-len(corners) :] == (0, 0, 1)).all()
        expected = integer_features(data.frames[circled[0]], data.background)[distance > 8]
        np.testing.assert_array_equal(corners[:beyond], expected)

        x, y = labelled_pixels(data, "train", flat_fraction=0.2, flat_beyond=2.0, seed=3)
        flat = (y == (0, 0, 1)).all(axis=1)
        assert flat.sum() / len(x) == pytest.approx(0.2, abs=0.003)
        resting = flat & (x[:, :4] == 0).all(axis=1)
        assert resting.sum() / flat.sum() == pytest.approx(0.5, abs=0.1)

        with pytest.raises(ValueError, match="no circle is in 'train'"):
            labelled_pixels(replace(data, indenter=None), "train", flat_beyond=2.0)

    def test_errors(self, tiny_data):
        with pytest.raises(ValueError, match="normals: missing"):
            labelled_pixels(replace(tiny_data, normals=None), "train")
        train_only = replace(tiny_data, split=np.full(len(tiny_data), "train"))
        with pytest.raises(ValueError, match="no frame in contact is in 'test'"):
            labelled_pixels(train_only, "test")
        flat_only = with_background(replace(tiny_data, split=np.full(len(tiny_data), "test")))
        with pytest.raises(ValueError, match="no frame in contact is in 'train'"):
            labelled_pixels(flat_only, "train")
        unknown = replace(tiny_data, valid=np.zeros(tiny_data.frames.shape[:3], bool))
        with pytest.raises(ValueError, match="no pixel of a frame in contact is labelled in 'train'"):
            labelled_pixels(unknown, "train")


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
