import numpy as np
import pytest
import torch

from fastac.models.training.force import hyperforce_3d
from fastac.models.training.force.hyperforce_3d import error_n, input_components, refit_last_layer, train

N = 14


def presses(count, seed):
    """Displacement fields of bumps at random positions with shear, and forces of a stiffness growing along
    x."""
    rng = np.random.default_rng(seed)
    v, u = np.indices((N, N))
    at = rng.uniform(3, N - 4, (count, 2, 1, 1))
    bump = np.exp(-((v - at[:, 0]) ** 2 + (u - at[:, 1]) ** 2) / 4)
    size = rng.uniform(-0.2, 0.2, (count, 3, 1, 1)) + np.array([0, 0, 0.5])[:, None, None]
    field = size * bump[:, None]
    force = (field * (1 + u / N)).sum(axis=(-2, -1)) * [2.0, 2.0, 1.0]
    return field.astype(np.float32), force


@pytest.fixture(scope="module")
def parts():
    splits = {"train": presses(48, 1), "validation": presses(24, 2)}
    return {k: v[0] for k, v in splits.items()}, {k: v[1] for k, v in splits.items()}


REST = 0.1 * np.add.outer(np.arange(N + 2.0), np.arange(N + 2.0))


def fit(make_scene, parts, checkpoint=None, training=None, **options):
    scene = make_scene(training={"force_epochs": 6} | (training or {}), force={"kernel_size": 3, "hidden": 8})
    return train(scene, REST, *parts, checkpoint=checkpoint, **options)


def weights(model):
    return model.collapsed().detach().numpy()


def test_learns_a_stiffness_that_depends_on_the_place(make_scene, parts):
    """Dynamic kernels beat a fixed one; from d_z alone the shear forces cannot be learned."""
    found = {}
    for inputs, dynamic in (("xyz", True), ("xyz", False), ("z", True)):
        model, _ = fit(make_scene, parts, inputs=inputs, dynamic=dynamic)
        scene = make_scene()
        x = input_components(scene, parts[0]["validation"], inputs)
        found[inputs, dynamic] = error_n(model, x, torch.from_numpy(parts[1]["validation"]))
    assert found["xyz", True] < 0.2 * found["xyz", False]
    assert found["xyz", True] < 0.1 * found["z", True]


def test_keeps_the_best_and_both_closed_forms_are_better_than_a_few_epochs(make_scene, parts):
    model, history = fit(make_scene, parts)
    assert [entry["epoch"] for entry in history] == list(range(8))
    x = input_components(make_scene(), parts[0]["validation"], "xyz")
    error = error_n(model, x, torch.from_numpy(parts[1]["validation"].astype(np.float32)))
    assert error == pytest.approx(min(entry["validation_mae_n"] for entry in history), rel=1e-5)
    descent = min(entry["validation_mae_n"] for entry in history[1:-1])
    assert max(history[0]["validation_mae_n"], history[-1]["validation_mae_n"]) < descent


def test_interrupted_training_goes_on_to_the_same_bits(make_scene, parts, tmp_path, monkeypatch):
    whole, curve = fit(make_scene, parts)
    path, judge, count = tmp_path / "new" / "run.npz", hyperforce_3d._Run.judge, 0

    def interrupted(self, *errors):
        nonlocal count
        count += 1
        if count == 4:
            raise KeyboardInterrupt
        judge(self, *errors)

    monkeypatch.setattr(hyperforce_3d._Run, "judge", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fit(make_scene, parts, path)
    monkeypatch.setattr(hyperforce_3d._Run, "judge", judge)
    epochs, epoch = [], hyperforce_3d._Run.epoch
    monkeypatch.setattr(hyperforce_3d._Run, "epoch", lambda self, *x: epochs.append(1) or epoch(self, *x))
    resumed, again = fit(make_scene, parts, path)
    assert len(epochs) == 3  # of six, three were kept
    assert again == curve
    np.testing.assert_array_equal(weights(resumed), weights(whole))
    fit(make_scene, parts, path)
    assert len(epochs) == 3


def test_stops_when_the_validation_error_no_longer_falls(make_scene, parts, monkeypatch):
    """With a learning rate so small that the validation error no longer falls."""
    monkeypatch.setattr(hyperforce_3d, "PATIENCE", 3)
    _, history = fit(make_scene, parts, training={"force_epochs": 400, "force_learning_rate": 3.0})
    errors = [entry["validation_mae_n"] for entry in history[1:-1]]
    assert len(errors) < 400
    assert min(errors[-3:]) > min(errors)
    assert np.argmin(errors) == len(errors) - 4


@pytest.mark.parametrize("content", [b"", b"nonsense"])
def test_a_damaged_checkpoint(make_scene, parts, tmp_path, content):
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"run\.npz: not a checkpoint of this training .*: delete it"):
        fit(make_scene, parts, path)


def test_a_checkpoint_of_another_model(make_scene, parts, tmp_path):
    path = tmp_path / "run.npz"
    fit(make_scene, parts, path, inputs="z")
    with pytest.raises(ValueError, match=r"run\.npz: not a checkpoint of this training"):
        fit(make_scene, parts, path, inputs="xyz")


def test_only_d_z_is_clamped(make_scene):
    field = -np.ones((2, 3, N, N), np.float32)
    signs = {"xyz": [-1, -1, 0], "xy": [-1, -1], "z": [0]}
    for inputs, expected in signs.items():
        chosen = input_components(make_scene(force={"clamp": True}), field, inputs)
        np.testing.assert_array_equal(chosen[0, :, 0, 0], expected)
        signed = input_components(make_scene(force={"clamp": False}), field, inputs)
        assert (signed == -1).all()
    assert (field == -1).all()


def test_refit_leaves_the_model_as_it_is(make_scene, parts):
    model, _ = fit(make_scene, parts, training={"force_epochs": 1})
    before = weights(model)
    x = {split: input_components(make_scene(), frames, "xyz") for split, frames in parts[0].items()}
    refit_last_layer(model, x, {k: 2 * v for k, v in parts[1].items()})
    np.testing.assert_array_equal(weights(model), before)


def test_needs_a_validation_split(make_scene, parts):
    with pytest.raises(ValueError, match="no frame is in 'validation'"):
        fit(make_scene, [{"train": part["train"]} for part in parts])


def test_the_seed_decides_everything(make_scene, parts):
    one, same, other = (
        weights(fit(make_scene, parts, training={"force_epochs": 1, "seed": seed})[0]) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
