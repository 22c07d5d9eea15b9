import numpy as np
import pytest

from fastac.models.training.force import ridge, smooth_weights

H, W = 12, 14


def fields(size: int, *, axes: int = 3, terms: int = 2, seed: int = 1) -> np.ndarray:
    """Random weight fields (axes, H, W, terms) made of the lowest size × size cosines."""
    spectrum = np.random.default_rng(seed).normal(size=(axes, size, size, terms))
    v, u = (smooth_weights.cosine_basis(length, size) for length in (H, W))
    return np.einsum("im,jn,amnt->aijt", v, u, spectrum)


def frames(count: int, *, terms: int = 2, seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, H, W, terms))


def force(change: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("nijt,aijt->na", change, weights)


def problem(weights: np.ndarray, *, noise: float = 0.0, validation: bool = True):
    """Differences of slopes, and forces with noise, by split name."""
    change = {"train": frames(80, terms=weights.shape[-1])}
    if validation:
        change["validation"] = frames(20, terms=weights.shape[-1], seed=3)
    rng = np.random.default_rng(4)
    truth = {s: force(x, weights) for s, x in change.items()}
    return change, {s: f + noise * rng.normal(size=f.shape) for s, f in truth.items()}


@pytest.mark.parametrize(("length", "size"), [(12, 12), (16, 4), (5, 1)])
def test_waves_are_orthonormal_cosines(length, size):
    found = smooth_weights.cosine_basis(length, size)
    np.testing.assert_allclose(found.T @ found, np.eye(size), atol=1e-12)
    middles = (np.arange(length) + 0.5) / length
    cosines = np.cos(np.pi * np.outer(middles, np.arange(size)))
    np.testing.assert_allclose(found, cosines / np.linalg.norm(cosines, axis=0), atol=1e-12)


def test_spectra_are_the_products_with_the_waves():
    change = frames(3)
    v, u = smooth_weights.cosine_basis(H, 4), smooth_weights.cosine_basis(W, 4)
    expected = np.einsum("im,jn,fijt->fmnt", v, u, change)
    np.testing.assert_allclose(smooth_weights.lowest_cosines(change, 4), expected, atol=1e-12)


@pytest.mark.parametrize("validation", [True, False])
@pytest.mark.parametrize(("size", "terms"), [(2, 2), (4, 2), (4, 3)])
def test_smooth_fields_come_back(size, terms, validation):
    weights = fields(size, terms=terms)
    found, _, history = smooth_weights.fit(*problem(weights, validation=validation))
    assert ridge.best(history)["cosines"] == size
    assert found.shape == weights.shape
    np.testing.assert_allclose(found, weights, atol=1e-5 * np.abs(weights).max())


def test_the_choice_s_error_is_what_its_weights_give():
    weights = fields(4)
    change, truth = problem(weights, noise=0.5)
    found, _, history = smooth_weights.fit(change, truth)
    error = np.abs(force(change["validation"], found) - truth["validation"]).sum(axis=1).mean()
    assert ridge.best(history)["validation_mae_n"] == pytest.approx(error, rel=1e-9)
    assert error > 0.1
    # All sizes that the image has, with every strength.
    sizes = [entry["cosines"] for entry in history]
    assert sorted(set(sizes)) == [2, 4, 6, 8, 10, 12]
    assert len(history) == 6 * len(ridge.REGULARISATION)


@pytest.mark.parametrize("patience", [1, 2])
def test_no_larger_size_is_tried_once_so_many_were_no_better(patience):
    change, truth = problem(fields(4), noise=0.5)
    found, _, history = smooth_weights.fit(change, truth, patience=patience)
    tried = list(dict.fromkeys(entry["cosines"] for entry in history))
    assert tried == [2, 4, 6, 8, 10, 12][: 2 + patience]
    every, *_ = smooth_weights.fit(change, truth)
    np.testing.assert_array_equal(found, every)


def test_sizes_are_tried_up_to_the_largest():
    model = smooth_weights.SmoothWeights(*problem(fields(2)))
    every = model.errors()
    assert model.errors(largest=7) == [entry for entry in every if entry["cosines"] <= 6]


def test_without_a_validation_split_all_frames_are_fitted_in_the_end():
    weights = fields(2)
    change, truth = problem(weights, noise=0.5, validation=False)
    found, _, history = smooth_weights.fit(change, truth)
    chosen = ridge.best(history)
    size = chosen["cosines"]
    x = smooth_weights.lowest_cosines(change["train"], size).reshape(80, -1)
    spectrum = ridge.fit(x, truth["train"], chosen)
    np.testing.assert_allclose(force(change["train"], found), x @ spectrum, atol=1e-9)


def test_without_a_validation_split_presses_that_are_named_are_held_out_whole():
    change, truth = problem(fields(2), noise=0.5, validation=False)
    places = {"train": np.arange(80) % 8}
    _, _, history = smooth_weights.fit(change, truth, together=places)
    x = {"train": smooth_weights.lowest_cosines(change["train"], 2).reshape(80, -1)}
    expected = [entry["validation_mae_n"] for entry in ridge.cross_validation_errors(x, truth, places)]
    found = [entry["validation_mae_n"] for entry in history if entry["cosines"] == 2]
    np.testing.assert_allclose(found, expected)


def test_the_frames_that_chose_can_be_fitted_in_the_end():
    change, truth = problem(fields(4), noise=0.5)
    alone, _, history = smooth_weights.fit(change, truth)
    places = {split: np.arange(len(values)) % 7 for split, values in change.items()}
    found, _, of_all = smooth_weights.fit(change, truth, with_validation=True, together=places)
    chosen = ridge.best(of_all)
    both = np.concatenate([change["train"], change["validation"]])
    x = smooth_weights.lowest_cosines(both, chosen["cosines"]).reshape(len(both), -1)
    spectrum = ridge.fit(x, np.concatenate([truth["train"], truth["validation"]]), chosen)
    np.testing.assert_allclose(force(both, found), x @ spectrum, rtol=1e-9)
    assert np.abs(found - alone).max() > 1e-3 * np.abs(alone).max()
    # All of them choose, not those of one split alone.
    strengths = [[entry["regularisation"] for entry in each] for each in (history, of_all)]
    assert strengths[0] == strengths[1]
    x = {
        split: smooth_weights.lowest_cosines(values, 2).reshape(len(values), -1)
        for split, values in change.items()
    }
    expected = ridge.cross_validation_errors(x, truth, places)
    errors = [entry["validation_mae_n"] for entry in of_all if entry["cosines"] == 2]
    np.testing.assert_allclose(errors, [entry["validation_mae_n"] for entry in expected])
    # Where nothing says what belongs together, those of the split validation choose.
    _, _, of_split = smooth_weights.fit(change, truth, with_validation=True)
    assert of_split == history


@pytest.mark.parametrize("validation", [True, False])
def test_the_dots_weights_come_back_beside_the_fields(validation):
    """Dots that carry as much force as the images do."""
    weights, of_dots = fields(4), np.random.default_rng(5).normal(scale=3, size=(3, 6, 2))
    change, truth = problem(weights, validation=validation)
    rng = np.random.default_rng(6)
    shifts = {split: rng.normal(size=(len(values), 6, 2)) for split, values in change.items()}
    truth = {
        split: values + np.einsum("fmk,amk->fa", shifts[split], of_dots) for split, values in truth.items()
    }
    found, found_dots, history = smooth_weights.fit(change, truth, shifts)
    assert ridge.best(history)["cosines"] == 4
    np.testing.assert_allclose(found, weights, atol=1e-5 * np.abs(weights).max())
    np.testing.assert_allclose(found_dots, of_dots, atol=1e-5 * np.abs(of_dots).max())
    _, none, without = smooth_weights.fit(change, truth)
    assert none is None
    assert ridge.best(without)["validation_mae_n"] > 1000 * ridge.best(history)["validation_mae_n"]


def test_images_of_which_only_the_dots_tell_something():
    """Where the images show nothing of the force, the dots alone explain it."""
    change, _ = problem(fields(2))
    of_dots, rng = np.random.default_rng(5).normal(size=(2, 3, 2)), np.random.default_rng(6)
    shifts = {split: rng.normal(size=(len(values), 3, 2)) for split, values in change.items()}
    truth = {split: np.einsum("fmk,amk->fa", values, of_dots) for split, values in shifts.items()}
    found, found_dots, _ = smooth_weights.fit(change, truth, shifts)
    np.testing.assert_allclose(found_dots, of_dots, atol=1e-6)
    np.testing.assert_allclose(found, 0, atol=1e-6)


def test_a_few_wrong_forces_do_not_lead_robust_fields_astray():
    weights, wrong = fields(4, axes=1), slice(0, 80, 10)
    change, truth = problem(weights, noise=0.5)
    truth["train"][wrong] -= 500
    recording = {split: np.arange(len(values)) % 4 for split, values in change.items()}
    error, averaged = {}, {}
    for robust in (False, True):
        found, *_ = smooth_weights.fit(change, truth, robust=robust)
        error[robust] = np.abs(force(frames(50, seed=7), found - weights)).mean()
        found, *_ = smooth_weights.fit(change, truth, robust=robust, recording=recording)
        averaged[robust] = np.abs(force(frames(50, seed=7), found - weights)).mean()
    assert error[True] < 0.4 * error[False]  # the size is chosen before
    assert averaged[True] < 0.4 * averaged[False]


def test_with_recordings_all_sizes_are_averaged_by_their_errors():
    change, truth = problem(fields(4), noise=2.0)
    shifts = {s: np.random.default_rng(9).normal(size=(len(x), 3, 2)) for s, x in change.items()}
    recording = {s: np.arange(len(values)) % 5 for s, values in change.items()}
    found, dots, history = smooth_weights.fit(change, truth, shifts, recording=recording, patience=1)
    assert [entry["cosines"] for entry in history] == np.repeat([2, 4, 6], len(ridge.REGULARISATION)).tolist()
    model = smooth_weights.SmoothWeights(change, truth, shifts)
    used = [entry for entry in history if entry["share"]]
    assert [entry["cosines"] for entry in used] == [2, 4, 6]
    errors = [entry["validation_mae_n"] for entry in used]
    for entry, size in zip(used, (2, 4, 6), strict=True):
        assert entry == ridge.best([e for e in history if e["cosines"] == size])
        assert entry["share"] == pytest.approx(entry["validation_mae_n"] ** -4 / sum(e**-4.0 for e in errors))
    parts = [model.weights(entry, with_validation=False) for entry in used]
    for k, values in enumerate((found, dots)):
        expected = sum(entry["share"] * part[k] for entry, part in zip(used, parts, strict=True))
        np.testing.assert_allclose(values, expected)


@pytest.mark.parametrize("scale", [1.0, 0.0])
def test_an_exact_fit_has_the_whole_average(scale, monkeypatch):
    """Even where its error is zero, so that no quotient of errors is known."""
    model = smooth_weights.SmoothWeights(*problem(fields(2)))
    history = [
        {"cosines": 2, "regularisation": 1e-9, "validation_mae_n": 1e-9 * scale},
        {"cosines": 4, "regularisation": 1e-9, "validation_mae_n": 1.0},
    ]
    found, dots, rated = model.average(history)
    assert rated[0]["share"] == pytest.approx(1)
    assert rated[1]["share"] == pytest.approx(0)
    assert dots is None
    np.testing.assert_allclose(found, fields(2), atol=1e-5)
