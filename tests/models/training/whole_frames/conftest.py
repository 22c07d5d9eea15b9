"""What the tests of training on whole frames share: a network, ball presses, a force of slopes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork


@pytest.fixture
def network(tiny_data) -> PixelNetwork:
    torch.manual_seed(1)
    return PixelNetwork(tiny_data.frames.shape[-1] + 2, (5, 4))


@pytest.fixture
def pressed(tiny_data):
    """The tiny frames as presses of a ball of 8 mm on a flat skin; frame 1 shows no contact."""
    count = len(tiny_data)
    radius_px = np.full(count, 5.0)
    radius_px[1] = np.nan
    return replace(
        tiny_data,
        depth_mm=None,
        rest_depth_mm=None,
        indenter={
            "center_px": np.full((count, 2), (7.0, 8.0)),
            "radius_px": radius_px,
            "ball_mm": np.full(count, 8.0),
        },
    )


@pytest.fixture
def of_slopes() -> dict:
    """Keys of a scene whose force is a weighted sum of the slopes."""
    return {
        "outputs": ["force_xyz"],
        "poisson": {"solver": "adjoint"},
        "force": {"fit": "slopes", "clamp": False},
    }
