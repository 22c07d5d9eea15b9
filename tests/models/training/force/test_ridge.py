import numpy as np
import pytest

from fastac.models.training.force import ridge


def problem(frames: int, features: int, *, axes: int = 2, noise: float = 0.0, seed: int = 1):
    """Features of very different scale, weights, and forces (frames, axes)."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(frames, features)) * 10.0 ** rng.uniform(-3, 3, features)
    weights = rng.normal(size=(features, axes)) / np.abs(x).max(axis=0)[:, None]
    return x, x @ weights + noise * rng.normal(size=(frames, axes)), weights


def test_without_regularisation_it_is_least_squares():
    x, force, _ = problem(40, 6, noise=0.1)
    expected = np.linalg.lstsq(x, force, rcond=None)[0]
    for weights in ridge.solve(x, force, np.array([0.0, 1e-14])):
        np.testing.assert_allclose(weights, expected, rtol=1e-8)


def test_without_regularisation_it_is_the_shortest_of_many_solutions():
    """More features than frames, all of one scale, so that scaling them has no effect."""
    rng = np.random.default_rng(3)
    x = np.sign(rng.normal(size=(8, 20)))
    force = rng.normal(size=(8, 1))
    (weights,) = ridge.solve(x, force, np.array([1e-13]))
    np.testing.assert_allclose(weights, np.linalg.pinv(x) @ force, atol=1e-9)


@pytest.mark.parametrize("largest", [4, ridge.LARGEST_SVD])
@pytest.mark.parametrize(("frames", "features"), [(40, 6), (12, 30), (9, 9)])
def test_solutions_are_those_of_the_normal_equations(frames, features, largest, monkeypatch):
    """By singular values as by the eigenvectors of either Gram matrix."""
    monkeypatch.setattr(ridge, "LARGEST_SVD", largest)
    x, force, _ = problem(frames, features, noise=0.1)
    strengths = np.array([1e-6, 1e-2, 1.0])
    found = ridge.solve(x, force, strengths)
    assert found.shape == (3, features, 2)
    spread = np.sqrt((x**2).mean(axis=0))
    scaled = x / spread
    unit = np.linalg.eigvalsh(scaled @ scaled.T).mean()
    for strength, weights in zip(strengths, found, strict=True):
        normal = scaled.T @ scaled + strength * unit * np.eye(features)
        expected = np.linalg.solve(normal, scaled.T @ force) / spread[:, None]
        np.testing.assert_allclose(weights * spread[:, None], expected * spread[:, None], atol=1e-8)


def test_a_feature_that_is_never_there_gets_no_weight():
    x, force, _ = problem(20, 4)
    x[:, 2] = 0
    found = ridge.solve(x, force, ridge.REGULARISATION)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[:, 2], 0, atol=1e-15)


def test_units_of_features_do_not_matter():
    x, force, _ = problem(20, 5, noise=0.1)
    units = np.array([1, 1e4, 1e-5, 3, 7])
    one, other = (ridge.solve(values, force, np.array([1e-3]))[0] for values in (x, x * units))
    np.testing.assert_allclose(other * units[:, None], one, rtol=1e-8)


def test_axes_do_not_mix():
    x, force, _ = problem(20, 5, noise=0.1)
    together = ridge.solve(x, force, ridge.REGULARISATION)
    for axis in range(2):
        alone = ridge.solve(x, force[:, [axis]], ridge.REGULARISATION)
        np.testing.assert_allclose(together[..., [axis]], alone, rtol=1e-9)


def splits(noise: float):
    """Training forces with noise of this standard deviation, validation forces without."""
    x, force, weights = problem(90, 20, noise=noise)
    held = x[60:]
    return {"train": x[:60], "validation": held}, {"train": force[:60], "validation": held @ weights}


def test_errors_are_those_of_the_weights_on_the_validation_split():
    x, force = splits(noise=0.5)
    history = ridge.validation_errors(x, force)
    assert [entry["regularisation"] for entry in history] == ridge.REGULARISATION.tolist()
    for entry in history:
        weights = ridge.fit(x["train"], force["train"], entry)
        error = np.abs(x["validation"] @ weights - force["validation"]).sum(axis=1).mean()
        assert entry["validation_mae_n"] == pytest.approx(error, rel=1e-9)


def test_noise_asks_for_more_regularisation():
    weak, strong = (
        ridge.best(ridge.validation_errors(*splits(noise)))["regularisation"] for noise in (0.0, 5.0)
    )
    assert weak == ridge.REGULARISATION[0]
    assert strong > 1e3 * weak


@pytest.mark.parametrize("validation", [True, False])
def test_what_is_chosen_is_the_best_attempt_fitted_to_all_training_frames(validation):
    x, force = splits(noise=0.5)
    if not validation:
        x, force = {"train": x["train"]}, {"train": force["train"]}
    weights, history = ridge.best_weights(x, force)
    assert history == ridge.validation_errors(x, force)
    expected = ridge.fit(x["train"], force["train"], ridge.best(history))
    np.testing.assert_allclose(weights, expected, rtol=1e-9)


def test_best_is_the_smallest_error():
    history = [{"validation_mae_n": error, "regularisation": k} for k, error in enumerate((3.0, 1.0, 2.0))]
    assert ridge.best(history)["regularisation"] == 1


def alone(x: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Groups of one frame each."""
    ends = np.cumsum([len(values) for values in x.values()])
    return {
        split: np.arange(end - len(values), end) for (split, values), end in zip(x.items(), ends, strict=True)
    }


def test_cross_validation_holds_each_frame_out_once():
    """Of frames of which one says nothing of the others, none is fitted by weights that knew it."""
    x = {"train": np.eye(20)[:12], "validation": np.eye(20)[12:]}
    force = {"train": np.arange(1.0, 13)[:, None], "validation": np.arange(13.0, 21)[:, None]}
    history = ridge.cross_validation_errors(x, force, alone(x))
    assert [entry["validation_mae_n"] for entry in history] == pytest.approx([10.5] * len(history))


def test_cross_validation_asks_for_the_noise_s_regularisation_too():
    weak, strong = (
        ridge.best(ridge.cross_validation_errors(*splits(noise), alone(splits(noise)[0])))["regularisation"]
        for noise in (0.0, 5.0)
    )
    assert strong > 1e3 * weak
    x, force = splits(0.5)
    joined = [{"train": np.concatenate([*values.values()])} for values in (x, force, alone(x))]
    assert ridge.cross_validation_errors(x, force, alone(x)) == ridge.cross_validation_errors(*joined)


def test_frames_that_belong_together_are_held_out_together():
    """Each group has a feature and a force of its own: what was seen says nothing of a group that was not."""
    group = np.arange(40) // 4
    x, force = np.eye(10)[group], (group + 1.0)[:, None]
    of_one = np.random.default_rng(1).permutation(40)
    given = [{"train": v[of_one[:30]], "validation": v[of_one[30:]]} for v in (x, force, group)]
    history = ridge.cross_validation_errors(*given)
    assert [entry["validation_mae_n"] for entry in history] == pytest.approx([5.5] * len(history))
    told = ridge.best(ridge.cross_validation_errors(*given[:2], alone(given[0])))
    assert told["validation_mae_n"] < 0.1


@pytest.mark.parametrize("groups", [None, 4, 5])
@pytest.mark.parametrize("validation", ["fitted", "kept", "missing"])
def test_groups_are_held_out_in_turn_where_all_are_fitted_and_there_are_five(groups, validation):
    x, force = splits(noise=0.5)
    if validation == "missing":
        x, force = {"train": x["train"]}, {"train": force["train"]}
    together = {split: np.arange(len(values)) % groups for split, values in x.items()} if groups else None
    history = ridge.held_out_errors(x, force, together, with_validation=validation == "fitted")
    if groups == 5 and validation != "kept":
        assert history == ridge.cross_validation_errors(x, force, together)
    else:
        assert history == ridge.validation_errors(x, force)


def test_groups_without_force_are_none_to_hold_out():
    """One press and many frames without contact: nothing would tell of the press."""
    x, force = splits(noise=0.5)
    force = {split: values * (np.arange(len(values)) < 9)[:, None] for split, values in force.items()}
    together = {split: np.maximum(np.arange(len(values)) - 8, 0) for split, values in x.items()}
    history = ridge.held_out_errors(x, force, together, with_validation=True)
    assert history == ridge.validation_errors(x, force)


@pytest.mark.parametrize("with_validation", [True, False])
def test_what_is_known_is_fitted(with_validation):
    x, force = splits(noise=0.5)
    entry = {"regularisation": 1e-4}
    found = ridge.fit_known(x, force, entry, with_validation=with_validation)
    count = 90 if with_validation else 60
    every = [np.concatenate([values["train"], values["validation"]])[:count] for values in (x, force)]
    np.testing.assert_array_equal(found, ridge.fit(*every, entry))


def test_of_errors_that_chance_explains_the_strongest_is_chosen():
    rows = [(1e-9, 3.0, 0.5), (1e-6, 2.9, 0.0), (1e-3, 3.05, 0.2), (1e-1, 3.2, 0.25)]
    history = [
        {"regularisation": r, "validation_mae_n": error, "standard_error_n": chance}
        for r, error, chance in rows
    ]
    assert ridge.strongest(history)["regularisation"] == 1e-3
    certain = [{**entry, "standard_error_n": 0.0} for entry in history]
    assert ridge.strongest(certain) == ridge.best(certain) == certain[1]


def test_standard_errors_are_those_of_differences_of_the_same_frames():
    x, force = splits(noise=0.5)
    history = ridge.validation_errors(x, force)
    weights = [ridge.fit(x["train"], force["train"], entry) for entry in history]
    errors = [np.abs(x["validation"] @ each - force["validation"]).sum(axis=1) for each in weights]
    smallest = errors[history.index(ridge.best(history))]
    for entry, error in zip(history, errors, strict=True):
        expected = np.std(error - smallest) / np.sqrt(len(error))
        assert entry["standard_error_n"] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert ridge.best(history)["standard_error_n"] == 0


def test_without_a_validation_split_every_fifth_frame_is_held_out():
    x, force, _ = problem(23, 6, noise=0.3)
    held = np.zeros(23, bool)
    held[[4, 9, 14, 19]] = True
    expected = ridge.validation_errors(
        {"train": x[~held], "validation": x[held]}, {"train": force[~held], "validation": force[held]}
    )
    assert ridge.validation_errors({"train": x}, {"train": force}) == expected


def test_what_cannot_be_fitted_is_refused():
    force = np.ones((4, 2))
    with pytest.raises(ValueError, match="split: 4 training frames without validation: expected 5"):
        ridge.check({"train": force})
    with pytest.raises(ValueError, match="force_n: zero in every training frame"):
        ridge.check({"train": 0 * force, "validation": force})
    ridge.check({"train": force * [0, 1], "validation": force})


def test_features_and_shifts_are_joined_and_their_weights_parted():
    rng = np.random.default_rng(1)
    x, shifts = rng.normal(size=(30, 5)), rng.normal(size=(30, 4, 2))
    of_features, of_dots = rng.normal(size=(5, 3)), rng.normal(size=(3, 4, 2))
    force = x @ of_features + np.einsum("fmk,amk->fa", shifts, of_dots)
    joined = ridge.joined(x, shifts)
    assert joined.shape == (30, 13)
    weights = np.linalg.lstsq(joined, force, rcond=None)[0]
    found, found_dots = ridge.parted(weights, 5)
    np.testing.assert_allclose(found, of_features, atol=1e-12)
    np.testing.assert_allclose(found_dots, of_dots, atol=1e-12)


def test_without_shifts_there_are_no_dots_weights():
    x = np.arange(6.0).reshape(2, 3)
    assert ridge.joined(x, None) is x
    weights = np.ones((3, 2))
    found, of_dots = ridge.parted(weights, 3)
    np.testing.assert_array_equal(found, weights)
    assert of_dots is None
