from math import comb

import numpy as np
import pytest

from fastac.models.floating.hyperforce import coordinates
from fastac.models.training.force import polynomial_weights, ridge

N = 11
ROW = np.linspace(-1, 1, N)
DOME = coordinates(ROW**2 + ROW[:, None] ** 2 + ROW)
"""Of a curved skin: z is no polynomial of x and y of a lower degree than 2."""


def weights(
    coordinate: np.ndarray, *, degree: int = 3, axes: int = 2, terms: int = 3, seed: int = 1
) -> np.ndarray:
    """Random weight fields (axes, N, N, terms) that are polynomials of the place."""
    of_place = polynomial_weights.monomials(coordinate, degree)
    coefficients = np.random.default_rng(seed).normal(size=(of_place.shape[1], axes, terms))
    return np.einsum("pm,mat->apt", of_place, coefficients).reshape(axes, N, N, terms)


def problem(truth: np.ndarray, *, validation: bool = True):
    """Images and the forces that the weights find in them, by split name."""
    counts = {"train": 150, "validation": 40} if validation else {"train": 150}
    rng = np.random.default_rng(2)
    images = {split: rng.normal(size=(count, *truth.shape[1:])) for split, count in counts.items()}
    return images, {s: np.einsum("fijt,aijt->fa", x, truth) for s, x in images.items()}


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_monomials_are_all_products_up_to_the_degree(degree):
    found = polynomial_weights.monomials(DOME, degree)
    assert found.shape == (N * N, comb(degree + 3, 3))
    x, y, z = DOME.reshape(-1, 3).T
    wanted = {
        tuple((x**i * y**j * z**k).round(12))
        for i in range(degree + 1)
        for j in range(degree + 1 - i)
        for k in range(degree + 1 - i - j)
    }
    assert {tuple(column.round(12)) for column in found.T} == wanted


@pytest.mark.parametrize("validation", [True, False])
@pytest.mark.parametrize("coordinate", [DOME, coordinates(np.zeros((N, N)))], ids=["curved", "flat"])
def test_weights_that_are_polynomials_are_found(coordinate, validation):
    truth = weights(coordinate)
    images, force_n = problem(truth, validation=validation)
    found, of_dots, history = polynomial_weights.fit(coordinate, images, force_n)
    np.testing.assert_allclose(found, truth, atol=1e-5 * np.abs(truth).max())
    assert of_dots is None
    assert [entry["regularisation"] for entry in history] == ridge.REGULARISATION.tolist()


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_the_degree_is_that_with_the_smallest_error_on_presses_held_out(degree):
    truth = weights(DOME, degree=degree)
    images, force_n = problem(truth)
    rng = np.random.default_rng(3)
    noise = 0.1 * np.std(force_n["train"])
    force_n = {split: values + noise * rng.normal(size=values.shape) for split, values in force_n.items()}
    together = {split: np.arange(len(v)) // 3 for split, v in images.items()}
    found, _, history = polynomial_weights.fit(DOME, images, force_n, with_validation=True, together=together)
    assert {entry["degree"] for entry in history} == {degree}
    assert np.abs(found - truth).mean() < 0.2 * np.abs(truth).mean()


def test_lower_degrees_come_first():
    every = polynomial_weights.powers(4)
    for degree in range(5):
        lower = polynomial_weights.powers(degree)
        np.testing.assert_array_equal(every[: len(lower)], lower)
        assert lower.sum(axis=1).max() == degree


def test_shifts_of_dots_are_weighed_beside_the_images():
    truth, of_shifts = weights(DOME), np.random.default_rng(3).normal(size=(2, 4, 2))
    images, force_n = problem(truth)
    rng = np.random.default_rng(4)
    shifts = {s: rng.normal(size=(len(v), 4, 2)) for s, v in images.items()}
    force_n = {s: v + np.einsum("fmk,amk->fa", shifts[s], of_shifts) for s, v in force_n.items()}
    found, of_dots, _ = polynomial_weights.fit(DOME, images, force_n, shifts)
    np.testing.assert_allclose(found, truth, atol=1e-5 * np.abs(truth).max())
    np.testing.assert_allclose(of_dots, of_shifts, atol=1e-5)


def test_both_splits_are_fitted_where_both_may_be_known():
    truth = weights(DOME)
    images, force_n = problem(truth)
    images = {"train": images["train"][:30], "validation": images["validation"]}  # 30 frames, 60 coefficients
    force_n = {"train": force_n["train"][:30], "validation": force_n["validation"]}
    together = {split: np.arange(len(v)) // 3 for split, v in images.items()}
    few, _, _ = polynomial_weights.fit(DOME, images, force_n, together=together)
    more, _, history = polynomial_weights.fit(DOME, images, force_n, with_validation=True, together=together)
    assert np.abs(few - truth).max() > 0.1
    np.testing.assert_allclose(more, truth, atol=1e-4 * np.abs(truth).max())
    expected = ridge.cross_validation_errors({s: _features(v) for s, v in images.items()}, force_n, together)
    for a, b in zip(history, expected, strict=True):
        assert a == pytest.approx({"degree": 3} | b, abs=1e-9)


def _features(images: np.ndarray) -> np.ndarray:
    of_place = polynomial_weights.monomials(DOME, 3)
    return np.einsum("pm,fpt->fmt", of_place, images.reshape(len(images), N * N, -1)).reshape(len(images), -1)


def test_a_term_that_presses_hardly_show_gets_no_weight():
    truth = weights(DOME)
    images, force_n = problem(truth)
    faint = {s: v * [1, 1, 0.5 * polynomial_weights.HARDLY_SHOWN] for s, v in images.items()}
    assert polynomial_weights.hardly_shown(faint["train"]).tolist() == [False, False, True]
    found, _, _ = polynomial_weights.fit(DOME, faint, force_n)
    assert not found[..., 2].any()
    assert found[..., :2].any(axis=(1, 2)).all()


def test_forces_that_are_all_zero_are_refused():
    images, force_n = problem(weights(DOME))
    with pytest.raises(ValueError, match="force_n: zero in every training frame"):
        polynomial_weights.fit(DOME, images, {s: 0 * v for s, v in force_n.items()})
