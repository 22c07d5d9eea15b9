"""The loss where the skin is known under a ball alone, or not everywhere."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.training.normals import ScaledNetwork, normal_loss
from fastac.models.training.whole_frames.partly_labelled import BallContacts, PartlyLabelled
from fastac.models.training.whole_frames.usable_frames import whole_frames
from fastac.sensor.geometry import rest_depth_mm

INDEX = np.array([0, 3])


def test_a_force_needs_no_depth(tiny_data, make_scene, network, of_slopes):
    scene = make_scene(**of_slopes, training={"force_weight": 1.0, "input_noise": 0.1})
    valid = np.ones(tiny_data.frames.shape[:3], bool)
    valid[:, :3] = False
    data = replace(tiny_data, depth_mm=None, valid=valid)
    frames = whole_frames(data, data, scene, rest_depth_mm(scene.sensor))
    assert type(frames) is PartlyLabelled
    frames.prepare(network)
    assert np.isfinite(frames.loss(network.train(), INDEX).item())


@pytest.fixture
def contacts(pressed, make_scene):
    """`contacts(valid=…, circle_margin=…)`: keys of the dataset and of `training`."""

    def made(valid: np.ndarray | None = None, **training) -> BallContacts:
        scene = make_scene(poisson={"mode": "difference"}, training={"depth_weight": 1.0, **training})
        data = replace(pressed, valid=valid)
        found = whole_frames(data, data, scene, np.zeros(pressed.frames.shape[1:3]))
        assert isinstance(found, BallContacts)
        return found

    return made


def under_the_ball_px() -> tuple[torch.Tensor, np.ndarray]:
    """The ball's surface at inner pixels (14, 14) in pixels of 0.25 mm, and distances from its centre."""
    v, u = np.indices((16, 16))[:, 1:-1, 1:-1]
    distance = np.hypot(u - 7, v - 8)
    return torch.from_numpy(-np.sqrt((8 / 2 / 0.25) ** 2 - distance**2)).float(), distance


def test_only_frames_that_show_a_contact_are_learned_from(contacts, tiny_data):
    train = tiny_data.indices("train")
    assert 1 in train
    assert contacts().index("train").tolist() == [k for k in train.tolist() if k != 1]


def test_circles_beyond_the_photograph_say_nothing_of_depth(contacts, pressed, tiny_data):
    pressed.indenter["center_px"][3] = (12.0, 8.0)
    train = tiny_data.indices("train")
    assert contacts().index("train").tolist() == [k for k in train.tolist() if k not in (1, 3)]


def test_the_shape_under_a_ball_counts_and_nothing_else_does(contacts):
    frames, (surface, distance) = contacts(), under_the_ball_px()
    inside = torch.from_numpy(distance <= 5)
    elsewhere = torch.where(inside, surface, 7.0) + 0.75  # a constant was not measured
    assert frames._depth_error(elsewhere[None], INDEX[:1]).item() == pytest.approx(0, abs=1e-9)
    step = torch.zeros_like(surface)
    step[distance == 0] = 1.0
    count = int(inside.sum())
    found = frames._depth_error((surface + step)[None], INDEX[:1]).item()
    assert found == pytest.approx((count - 1) / count**2, rel=1e-4)
    twice = torch.stack([surface, surface + step])
    assert frames._depth_error(twice, INDEX).item() == pytest.approx(found / 2, rel=1e-4)


@pytest.mark.parametrize("way", ["margin", "valid"])
def test_neither_the_rim_nor_invalid_pixels_count(contacts, tiny_data, way):
    surface, distance = under_the_ball_px()
    wrong = surface + torch.from_numpy(10.0 * (distance > 4)).float()
    assert contacts()._depth_error(wrong[None], INDEX[:1]) > 1
    if way == "margin":
        frames = contacts(circle_margin=0.2)
    else:
        valid = np.ones(tiny_data.frames.shape[:3], bool)
        valid[:, 1:-1, 1:-1] = distance <= 4
        frames = contacts(valid)
    assert frames._depth_error(wrong[None], INDEX[:1]).item() == pytest.approx(0, abs=1e-9)


def test_labelled_pixels_are_drawn_while_the_network_is_trained(contacts, network):
    """Disturbed by the scene's noise. A network that is judged sees the frames' own labelled pixels."""
    frames = contacts(input_noise=0.1, position_noise=0.1)
    network.train()
    torch.manual_seed(1)
    first, second = (frames.loss(network, INDEX).item() for _ in range(2))
    torch.manual_seed(1)
    assert frames.loss(network, INDEX).item() == first != second
    network.eval()
    with torch.no_grad():
        found = frames.loss(network, INDEX).item()
        assert found == frames.loss(network, INDEX).item()
        normals, *slopes = frames._found(network, INDEX)
    truth = torch.from_numpy(frames.data.normals[INDEX].reshape(-1, 3).astype(np.float32))
    expected = normal_loss(normals.reshape(-1, 3), truth) + frames._depth_error(frames._depth(*slopes), INDEX)
    assert found == pytest.approx(expected.item(), rel=1e-5)


def test_what_is_trained_may_be_wrapped(contacts, network):
    """The frames scale features themselves: what scales them again would be another network."""
    frames = contacts()
    network.eval()
    twice = ScaledNetwork(copy.deepcopy(network), np.ones(6)).eval()
    assert frames.loss(network, INDEX) == frames.loss(twice, INDEX)
