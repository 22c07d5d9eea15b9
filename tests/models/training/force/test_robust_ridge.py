"""Ridge regression with Huber's loss."""

import numpy as np
import pytest
from scipy.optimize import minimize

from fastac.models.training.force import ridge, robust_ridge

TRUTH = np.array([[3.0, -1.0], [0.5, 2.0], [-2.0, 0.0], [0.0, 1.0]])
RNG = np.random.default_rng(1)
X = RNG.normal(size=(200, 4)) * (1, 10, 0.1, 3)
NOISE = 0.1 * RNG.normal(size=(200, 2))
LITTLE = {"regularisation": 1e-9}


def test_wrong_forces_do_not_lead_it_astray():
    force_n = X @ TRUTH + NOISE
    right = robust_ridge.fit(X, force_n, LITTLE)
    force_n[:20, 0] -= 100.0
    force_n[50:70, 1] += 50.0
    found = robust_ridge.fit(X, force_n, LITTLE)
    scale = np.sqrt((X**2).mean(axis=0))[:, None]
    assert np.abs((found - right) * scale).max() < 0.05
    assert np.abs((ridge.fit(X, force_n, LITTLE) - right) * scale).max() > 1


def test_it_minimises_huber_s_loss():
    """Of the limit that its own errors give, and of each axis alone."""
    force_n = (X @ TRUTH + NOISE)[:, :1]
    force_n[::7] *= -1
    scale = np.sqrt((X**2).mean(axis=0))
    found = robust_ridge.fit(X, force_n, LITTLE)[:, 0]
    error_n = np.abs(X @ found - force_n[:, 0])
    limit_n = robust_ridge.TUNING * robust_ridge.NORMAL * np.median(error_n)

    def loss(weights):
        error_n = np.abs(X @ (weights / scale) - force_n[:, 0])
        return np.where(error_n < limit_n, error_n**2 / 2, limit_n * (error_n - limit_n / 2)).sum()

    best = minimize(loss, found * scale, method="BFGS")
    np.testing.assert_allclose(found * scale, best.x, atol=2e-3 * np.abs(best.x).max())
    assert loss(found * scale) < 0.9 * loss(ridge.fit(X, force_n, LITTLE)[:, 0] * scale)


@pytest.mark.parametrize("regularisation", [1e-6, 1e-2, 1.0])
def test_where_no_error_is_large_it_is_ridge(monkeypatch, regularisation):
    monkeypatch.setattr(robust_ridge, "TUNING", 1e3)
    force_n, attempt = X @ TRUTH + NOISE, {"regularisation": regularisation}
    np.testing.assert_allclose(
        robust_ridge.fit(X, force_n, attempt), ridge.fit(X, force_n, attempt), rtol=1e-9
    )


def test_exact_forces_come_back():
    """More features than frames' errors can tell apart, one of which is zero everywhere."""
    x = np.concatenate([X, X[:, :1], np.zeros((200, 1))], axis=1)
    found = robust_ridge.fit(x, X @ TRUTH, LITTLE)
    np.testing.assert_allclose(x @ found, X @ TRUTH, atol=1e-6)
    assert not found[-1].any()


def test_without_any_force_there_are_no_weights():
    assert not robust_ridge.fit(X, np.zeros((200, 1)), LITTLE).any()
    assert not robust_ridge.fit(np.zeros((5, 2)), np.ones((5, 1)), LITTLE).any()
