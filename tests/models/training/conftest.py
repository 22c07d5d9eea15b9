"""Surfaces whose slopes channels show."""

import numpy as np
import pytest


@pytest.fixture(scope="session")
def dents():
    """Slopes (120, 24, 24, 2) of dents at chance places, and how three channels mix them, (2, 3)."""
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[:24, :24].astype(float)
    slopes = []
    for _ in range(120):
        x, y = rng.uniform(8, 15, 2)
        wide, high = rng.uniform(2, 4, 2)
        dent = rng.uniform(1, 4) * np.exp(-(((columns - x) / wide) ** 2) - ((rows - y) / high) ** 2)
        slopes.append([-2 * (columns - x) / wide**2 * dent, -2 * (rows - y) / high**2 * dent])
    return np.moveaxis(np.array(slopes), 1, -1), rng.normal(size=(2, 3))
