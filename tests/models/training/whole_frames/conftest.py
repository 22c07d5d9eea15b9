"""What the tests of training on whole frames share: a network, ball presses, a force of slopes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.flow.training import skin_alone
from fastac.models.floating.network import PixelNetwork
from fastac.models.training.whole_frames import force_features
from fastac.models.training.whole_frames.force_residual import ForceResidual
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.sensor.geometry import rest_depth_mm


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


@pytest.fixture(params=["skin", "under dots"])
def residual(request, make_scene, dotted_scene, of_slopes, monkeypatch) -> ForceResidual:
    """Of few features, on presses of a skin without and with dots, whose slopes are bridged."""
    monkeypatch.setattr(force_features, "SLOPES_SIZE", 2)
    if request.param == "skin":
        data, scene = request.getfixturevalue("tiny_data"), make_scene(**of_slopes)
    else:
        data = request.getfixturevalue("dotted_data")
        changes = {**of_slopes, "force": {**of_slopes["force"], "dots": True}}
        sensor = dotted_scene.sensor.model_dump(exclude_unset=True)
        scene = make_scene(**changes, sensor=sensor, network={"bridge_dots": True})
    torch.manual_seed(1)
    network = PixelNetwork(data.frames.shape[-1] + 2, (5, 4))
    with torch.no_grad():
        network.linear_layers[-1].bias[2] = 2.0  # normals look at the camera: no slope is clipped
    frames = WholeFrames(data, skin_alone(data, scene), scene, rest_depth_mm(scene.sensor))
    return ForceResidual(frames, network, data.indices("train"))
