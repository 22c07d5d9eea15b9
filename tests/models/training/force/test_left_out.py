"""Errors on recordings left out are those of fits without them."""

import numpy as np
import pytest

from fastac.models.training.force import left_out, ridge

FRAMES = 120


def problem(features: int, *, axes: int = 1, noise: float = 0.5, seed: int = 1):
    """Features whose sizes differ, one of which is zero everywhere, and forces with errors."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(FRAMES, features)) * rng.uniform(0.1, 10, features)
    x[:, -1] = 0
    force_n = x[:, :axes] + rng.normal(size=(FRAMES, axes)) * noise
    return x, force_n, rng


@pytest.mark.parametrize("features", [6, 30, 100, 200])
@pytest.mark.parametrize("groups", [2, 8, 11])
def test_each_recording_is_left_out_and_counts_alike(features, groups):
    """Eleven are left out in eight parts. More features than frames have the same ridge regressions."""
    x, force_n, rng = problem(features, axes=2)
    name = np.array(
        [f"{k:02}" for k in rng.permutation(np.minimum(np.arange(FRAMES) % (groups + 2), groups - 1))]
    )
    assert len(set(name)) == groups
    scaled = x / ridge.root_mean_squares(x)
    errors = np.zeros(len(ridge.REGULARISATION))
    for k in range(groups):
        seen = ~np.isin(name, [f"{j:02}" for j in range(groups) if j % 8 == k % 8])
        for row, strength in enumerate(ridge.REGULARISATION):
            own = scaled[seen]
            penalty = strength * np.square(own).sum() / len(own)
            out = scaled[name == f"{k:02}"]
            gram = own @ own.T + penalty * np.eye(len(own))
            estimate = out @ own.T @ np.linalg.solve(gram, force_n[seen])
            errors[row] += np.abs(estimate - force_n[name == f"{k:02}"]).sum(axis=1).mean() / groups
    chosen = left_out.errors_n(x, force_n, name, ridge.REGULARISATION[[12]])
    assert chosen == pytest.approx(errors[[12]], rel=1e-3)
    strong = ridge.REGULARISATION >= 1e-6  # the weakest are rounded otherwise
    found = left_out.errors_n(x, force_n, name)
    np.testing.assert_allclose(found[strong], errors[strong], rtol=1e-3)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("features", [6, 100, 200])
def test_one_fit_says_what_all_would(features, robust, monkeypatch):
    """With wrong forces, whose frames count less; the weakest strengths are rounded."""
    x, force_n, _ = problem(features, axes=2)
    force_n[::10] += 50
    found = []
    for many in (0, np.inf):
        monkeypatch.setattr(left_out, "MANY", many)
        found.append(left_out.errors_n(x, force_n, np.arange(FRAMES) % 7, robust=robust))
    one, every = found
    strong = ridge.REGULARISATION >= 1e-7
    np.testing.assert_allclose(one[strong], every[strong], rtol=1e-5)
    np.testing.assert_allclose(one, every, rtol=0.05)


def test_what_recordings_share_alone_is_worth_something():
    """A feature that tells the recording explains the known ones and says nothing of another."""
    rng = np.random.default_rng(2)
    name = np.repeat(np.arange(6), 20)
    level = rng.normal(size=6)[name]
    x = np.stack([level + 0.01 * rng.normal(size=FRAMES), rng.normal(size=FRAMES)], axis=1)
    force_n = (x[:, 1] + 3 * np.sin(40 * level))[:, None]
    neighbours = np.arange(FRAMES) % 6
    assert left_out.errors_n(x, force_n, name).min() > 1.1 * left_out.errors_n(x, force_n, neighbours).min()


def test_wrong_forces_do_not_lead_robust_fits_astray():
    x, force_n, _ = problem(5, noise=0.1)
    name, wrong = np.arange(FRAMES) % 4, np.arange(0, FRAMES, 12)
    force_n[wrong] -= 100.0
    robust, plain = (left_out.errors_n(x, force_n, name, robust=flag).min() for flag in (True, False))
    of_wrong_n = 100 * len(wrong) / FRAMES
    assert robust < of_wrong_n + 0.5
    assert plain > of_wrong_n + 3


def test_without_force_no_error():
    x, force_n, _ = problem(5)
    for robust in (True, False):
        assert not left_out.errors_n(x, 0 * force_n, np.arange(FRAMES) % 3, robust=robust).any()
        both = np.concatenate([force_n, 0 * force_n], axis=1)
        np.testing.assert_array_equal(
            left_out.errors_n(x, both, np.arange(FRAMES) % 3, robust=robust),
            left_out.errors_n(x, force_n, np.arange(FRAMES) % 3, robust=robust),
        )


def test_one_recording_cannot_be_left_out():
    x, force_n, _ = problem(5)
    with pytest.raises(ValueError, match=r"recording = \['plum'\]: expected at least two to leave one out"):
        left_out.errors_n(x, force_n, np.full(FRAMES, "plum"))
