import numpy as np
import pytest
import torch

from fastac.models.training.force import ridge
from fastac.models.training.force.hyperforce import build, refit_last_layer, train

N = 14


def presses(count: int, seed: int, *, axes: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Gaussian dents, and forces with a stiffness that grows with u."""
    rng = np.random.default_rng(seed)
    v, u = np.indices((N, N))
    centre = rng.uniform(3, N - 4, (count, 2, 1, 1))
    depth = rng.uniform(0.2, 1, (count, 1, 1))
    d = depth * np.exp(-((u - centre[:, 0]) ** 2 + (v - centre[:, 1]) ** 2) / 8)
    stiffness = 0.01 * (1 + u / N)
    force = (d * stiffness).sum(axis=(1, 2))[:, None] * np.arange(1, axes + 1)
    return d - 0.05 * (d < 0.02), force  # bulges around the dents, which do not count


def fit(scene, *, count: int = 64, axes: int = 1, validation: bool = True, **settings):
    changed = scene.model_copy(update={"training": scene.training.model_copy(update=settings)})
    d, f = presses(count, 1, axes=axes)
    displacement, force = {"train": d}, {"train": f}
    if validation:
        displacement["validation"], force["validation"] = presses(16, 2, axes=axes)
    rest = np.ones((N + 2, N + 2))
    return train(changed, rest, displacement, force), displacement, force


def error(model, d: np.ndarray, f: np.ndarray) -> float:
    """Mean over frames of the summed absolute errors, from the kernels' weight on each pixel."""
    weight = model.collapsed().detach().double().numpy()
    return float(np.abs(np.einsum("fij,aij->fa", np.maximum(d, 0), weight) - f).sum(axis=1).mean())


@pytest.mark.parametrize("axes", [1, 2])
def test_learns_a_law_that_depends_on_the_position(tiny_scene, axes):
    (model, history), d, f = fit(tiny_scene, axes=axes, force_epochs=60, force_learning_rate=5e-3)
    assert history[-1]["train_mae_n"] < 0.1 * history[0]["train_mae_n"]
    # One weight for all positions cannot do this.
    total = np.maximum(d["validation"], 0).sum(axis=(1, 2))
    constant = np.abs(
        f["validation"] - total[:, None] * (f["train"].sum(0) / np.maximum(d["train"], 0).sum())
    )
    assert error(model, d["validation"], f["validation"]) < 0.4 * constant.sum(axis=1).mean()


def test_keeps_the_best_epoch_on_validation(make_scene):
    """Trained on forces of the wrong sign, the validation error grows with every epoch."""
    scene = make_scene(training={"force_epochs": 12, "force_learning_rate": 5e-3})
    (d, f), (held_out, truth) = presses(64, 1), presses(16, 2)
    rest = np.ones((N + 2, N + 2))
    model, history = train(
        scene, rest, {"train": d, "validation": held_out}, {"train": -f, "validation": truth}
    )
    errors = [entry["validation_mae_n"] for entry in history]
    assert errors[-1] > 1.2 * min(errors)
    assert error(model, held_out, truth) <= min(errors) * 1.001


def test_keeps_the_last_epoch_without_validation(tiny_scene):
    (_, history), _, _ = fit(tiny_scene, validation=False, force_epochs=2)
    assert [set(entry) for entry in history] == [{"epoch", "train_mae_n"}] * 2


def test_bulges_do_not_count(tiny_scene):
    """Negative displacements are set to zero before training."""
    d, f = presses(16, 1)
    rest = np.ones((N + 2, N + 2))
    one, _ = train(tiny_scene, rest, {"train": d}, {"train": f})
    other, _ = train(tiny_scene, rest, {"train": np.where(d < 0, -9, d)}, {"train": f})
    np.testing.assert_array_equal(one.collapsed().detach(), other.collapsed().detach())


@pytest.mark.parametrize("epochs", range(1, 13))
def test_trainings_of_any_length(tiny_scene, epochs):
    """One step per epoch; with ten steps or fewer, OneCycleLR's warm-up would divide by zero."""
    (model, history), _, _ = fit(tiny_scene, count=8, validation=False, force_epochs=epochs)
    assert len(history) == epochs
    assert torch.isfinite(model.collapsed()).all()


def test_kernels_start_with_forces_of_the_right_order(tiny_scene):
    (_, history), _, f = fit(tiny_scene, force_epochs=1)
    assert history[0]["train_mae_n"] < 5 * f["train"].mean()


def test_the_seed_decides_everything(tiny_scene):
    (one, _), _, _ = fit(tiny_scene, force_epochs=1)
    torch.manual_seed(5)
    (same, _), _, _ = fit(tiny_scene, force_epochs=1)
    (other, _), _, _ = fit(tiny_scene, force_epochs=1, seed=2)
    np.testing.assert_array_equal(one.collapsed().detach(), same.collapsed().detach())
    assert (one.collapsed() != other.collapsed()).any()


def test_build_takes_size_and_shape_from_the_scene(make_scene):
    scene = make_scene(force={"kernel_size": 7, "hidden": 9})
    rest = np.random.default_rng(1).random((16, 16))
    model = build(scene, rest, axes=3)
    assert model.kernels().shape == (3, 14, 14, 7, 7)
    assert model.layers[0].out_features == 9
    # Coordinates of the inner pixels only.
    z = model.coordinate.reshape(14, 14, 3)[..., 2].numpy()
    inner = rest[1:-1, 1:-1]
    np.testing.assert_allclose(z, 2 * (inner - inner.min()) / np.ptp(inner) - 1, atol=1e-6)


class TestRefit:
    """Refitting the last layer of trained kernels to another pipeline's displacements."""

    @staticmethod
    def parts():
        """Presses of two splits, and the same presses with an offset, unknown to the first kernels."""
        (d, f), (held_out, truth) = presses(64, 1), presses(16, 2)
        plain = {"train": d, "validation": held_out}
        noisy = {split: np.maximum(value, 0) + 0.02 for split, value in plain.items()}
        return plain, noisy, {"train": f, "validation": truth}

    @pytest.mark.parametrize("kernel_size", [1, 3])
    def test_fits_the_other_displacements(self, make_scene, kernel_size):
        scene = make_scene(training={"force_epochs": 40}, force={"kernel_size": kernel_size})
        plain, noisy, force = self.parts()
        first, _ = train(scene, np.ones((N + 2, N + 2)), plain, force)
        weights = first.collapsed().detach().clone()
        second, _, history = refit_last_layer(scene, first, noisy, force)
        before = error(first, noisy["validation"], force["validation"])
        after = error(second, noisy["validation"], force["validation"])
        assert after < 0.7 * before
        # What the choice was made by is what the kernels do.
        assert after == pytest.approx(ridge.strongest(history)["validation_mae_n"], rel=1e-3)
        np.testing.assert_array_equal(first.collapsed().detach(), weights)  # the first ones stay

    def test_is_no_worse_on_what_it_was_trained_on(self, make_scene):
        scene = make_scene(training={"force_epochs": 20})
        plain, _, force = self.parts()
        first, _ = train(scene, np.ones((N + 2, N + 2)), plain, force)
        second, *_ = refit_last_layer(scene, first, plain, force)
        before = error(first, plain["validation"], force["validation"])
        assert error(second, plain["validation"], force["validation"]) <= before

    def test_without_a_validation_split(self, make_scene):
        scene = make_scene(training={"force_epochs": 20})
        plain, noisy, force = self.parts()
        first, _ = train(scene, np.ones((N + 2, N + 2)), plain, force)
        known = [{"train": values["train"]} for values in (noisy, force)]
        second, _, history = refit_last_layer(scene, first, *known)
        _, _, by_press = refit_last_layer(scene, first, *known, together={"train": np.arange(64) // 8})
        assert by_press != history
        before = error(first, noisy["validation"], force["validation"])
        assert error(second, noisy["validation"], force["validation"]) < before

    def test_fitted_to_both_splits_it_errs_less_on_the_second(self, make_scene):
        scene = make_scene(training={"force_epochs": 2})
        plain, noisy, force = self.parts()
        first, _ = train(scene, np.ones((N + 2, N + 2)), plain, force)
        one, _, history = refit_last_layer(scene, first, noisy, force)
        other, _, same = refit_last_layer(scene, first, noisy, force, with_validation=True)
        assert same == history
        of_one, of_other = (error(m, noisy["validation"], force["validation"]) for m in (one, other))
        assert of_other < 0.99 * of_one

    def test_presses_of_both_splits_choose_the_regularisation_where_both_are_fitted(self, make_scene):
        scene = make_scene(training={"force_epochs": 2})
        plain, noisy, force = self.parts()
        first, _ = train(scene, np.ones((N + 2, N + 2)), plain, force)
        press = {split: np.arange(len(values)) // 2 for split, values in force.items()}
        press["validation"] += len(force["train"])

        def errors(**options: bool) -> list[dict]:
            return refit_last_layer(scene, first, noisy, force, together=press, **options)[2]

        assert errors(with_validation=False) == refit_last_layer(scene, first, noisy, force)[2]
        assert errors(with_validation=True) != errors(with_validation=False)
        press["train"] = press["train"] * 0  # with too few to hold out in turn, the validation split chooses
        press["validation"] = press["validation"] * 0
        assert errors(with_validation=True) == errors(with_validation=False)

    def test_axes_do_not_mix(self, make_scene):
        scene = make_scene(outputs=["force_x", "force_z"], training={"force_epochs": 2})
        plain, _, force = self.parts()
        both = {split: np.concatenate([-2 * value, value], axis=1) for split, value in force.items()}
        first, _ = train(scene, np.ones((N + 2, N + 2)), plain, both)
        second, *_ = refit_last_layer(scene, first, plain, both)
        x, z = second.collapsed().detach()
        np.testing.assert_allclose(x, -2 * z, atol=1e-4 * float(z.abs().max()))

    @pytest.mark.parametrize("validation", [True, False])
    def test_dots_weights_come_back(self, make_scene, validation):
        """The force that the dots carry is found beside the kernels', which stay what they are without it."""
        scene = make_scene(training={"force_epochs": 20})
        plain, noisy, force = self.parts()
        first, _ = train(scene, np.ones((N + 2, N + 2)), plain, force)
        splits = ("train", "validation") if validation else ("train",)
        pressed = {split: noisy[split] for split in splits}
        rng, of_dots = np.random.default_rng(7), np.array([[[0.3, -0.2], [0.0, 0.5], [-0.1, 0.4]]])
        shifts = {split: rng.normal(size=(len(noisy[split]), 3, 2)) for split in splits}
        both = {split: force[split] + np.einsum("fmk,amk->fa", shifts[split], of_dots) for split in splits}
        _, none, alone = refit_last_layer(scene, first, pressed, both)
        model, found, history = refit_last_layer(scene, first, pressed, both, shifts)
        assert none is None
        np.testing.assert_allclose(found, of_dots, atol=0.02)
        best, worst = (min(entry["validation_mae_n"] for entry in part) for part in (history, alone))
        assert best < 0.1 * worst
        assert error(model, noisy["validation"], force["validation"]) < 0.1 * worst
