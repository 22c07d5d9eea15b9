"""Both integer solvers at the sizes that scenes allow: words within 26 bits, close to the float solver."""

import numpy as np
import pytest

from fastac.models.floating.poisson import solve
from fastac.models.integer.solvers import SOLVERS
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import Fixed

WIDTH_MM = 16.0
FRACTION, WIDTH = 14, 17
"""Of a slope's word, up to 4 px per px."""
DATA_BITS = 26


def slopes_of(depth_px: np.ndarray) -> np.ndarray:
    """Integer slopes (N + 2, N + 2, 2) of a depth on as many pixels."""
    slopes = np.stack(np.gradient(depth_px)[::-1], axis=-1)
    return np.rint(slopes * 2**FRACTION).astype(np.int64)


@pytest.mark.parametrize("name", list(SOLVERS))
@pytest.mark.parametrize(
    ("size", "divergence"),
    [
        *((size, divergence) for size in (14, 15, 30, 62, 127) for divergence in ("central", "backward")),
        (254, "central"),
    ],
)
@pytest.mark.quick("15-central-dst2d", "30-central-tridiagonal", "14-backward-dst2d")
def test_a_ball_on_a_curved_skin_at_every_size(name, size, divergence):
    """In difference mode: mean error below 0.1 µm, peak below 1 µm, on an image 16 mm wide."""
    pitch = WIDTH_MM / (size + 2)
    v, u = (np.indices((size + 2, size + 2)) - (size + 1) / 2) * pitch
    rest = 9 * np.sqrt(1 - (u / 12) ** 2 - (v / 14) ** 2)
    inside = np.minimum(np.hypot(u - 1, v + 2), 1.5)
    ball = np.sqrt(2.5**2 - inside**2) - np.sqrt(2.5**2 - 1.5**2)
    offset = PoissonSource(divergence, WIDTH, np.zeros((size, size), int))(slopes_of(rest / pitch))
    source = PoissonSource(divergence, WIDTH, offset)
    fraction = FRACTION + (divergence == "central")
    chosen = SOLVERS[name].fitted(
        offset=offset,
        source=Fixed(source.width, fraction),
        slope_limit=((1 << (WIDTH - 1)) - 1) / 2**FRACTION,
        divergence=divergence,
        coefficient_fraction=17,
        data_bits=DATA_BITS,
    )
    formats = [stage.format for stage in chosen.stages]
    assert max(word.width for word in formats) <= DATA_BITS
    for stage in chosen.stages:
        assert stage.bound_px <= stage.format.to_float((1 << (stage.format.width - 1)) - 1)
    words = source(slopes_of((rest - ball) / pitch))
    found = chosen.depth_format.to_float(chosen(words))
    error_um = 1e3 * pitch * np.abs(found - solve(words * 2.0**-fraction))
    assert error_um.mean() < 0.1
    assert error_um.max() < 1
    assert np.abs(found).max() * pitch > 0.2  # the ball is there
