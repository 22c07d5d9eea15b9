"""The loss of normals, depth and force, where the whole skin is known and where it is under a ball alone."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.flow.training import TrainingError, require, skin_alone
from fastac.models.floating.network import PixelNetwork, predict
from fastac.models.integer.features import integer_features
from fastac.models.training.force import ridge
from fastac.models.training.normals import ScaledNetwork, normal_loss
from fastac.models.training.whole_frames import frames as of_whole_frames
from fastac.models.training.whole_frames.frames import (
    BallContacts,
    PartlyLabelled,
    WholeFrames,
    unknown_depth,
    whole_frames,
)
from fastac.models.training.whole_frames.held_out_force import REGULARISATION
from fastac.models.training.whole_frames.network_depth import found_depth_mm
from fastac.models.training.whole_frames.pixel_grid import every
from fastac.models.vision.dots import slope_bridge
from fastac.sensor.geometry import rest_depth_mm

INDEX = np.array([0, 3])
OF_SLOPES = {
    "outputs": ["force_xyz"],
    "poisson": {"solver": "adjoint"},
    "force": {"fit": "slopes", "clamp": False},
}


@pytest.fixture
def network(tiny_data) -> PixelNetwork:
    torch.manual_seed(1)
    return PixelNetwork(tiny_data.frames.shape[-1] + 2, (5, 4))


@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_normals_and_depth_of_whole_skins(tiny_data, make_scene, network, mode):
    training = {"depth_weight": 3.0, "huber_delta": 0.1}
    scene = make_scene(poisson={"mode": mode}, training=training)
    rest, chosen = rest_depth_mm(scene.sensor), np.ones(tiny_data.frames.shape[:3], bool)
    chosen[3, 4:9] = False
    frames = WholeFrames(tiny_data, replace(tiny_data, valid=chosen), scene, rest)
    found = predict(network, integer_features(tiny_data.frames[INDEX], tiny_data.background))[chosen[INDEX]]
    truth = tiny_data.normals[INDEX][chosen[INDEX]]
    expected = normal_loss(torch.from_numpy(found), torch.from_numpy(truth.astype(float)), 0.1).item()
    depth_mm = found_depth_mm(network, tiny_data.frames[INDEX], tiny_data, scene, rest_depth_mm=rest)
    error_px = (depth_mm - tiny_data.depth_mm[INDEX][:, 1:-1, 1:-1]) / scene.sensor.pitch_mm
    expected += 3 * np.square(error_px).mean()
    assert frames.loss(network, INDEX).item() == pytest.approx(expected, rel=1e-4)


def test_normals_that_are_not_learned_from_do_not_count(tiny_data, make_scene, network):
    scene = make_scene(training={"depth_weight": 1.0})
    valid, wrong = np.zeros(tiny_data.frames.shape[:3], bool), tiny_data.normals.copy()
    valid[:, 4:12, 4:12] = True
    wrong[~valid] = [1, 0, 0]
    first, second = (
        WholeFrames(
            tiny_data, replace(tiny_data, normals=normals, valid=valid), scene, rest_depth_mm(scene.sensor)
        )
        for normals in (tiny_data.normals, wrong)
    )
    assert first.loss(network, INDEX) == second.loss(network, INDEX)


def test_slopes_under_dots_are_bridged(dotted_data, dotted_scene, network):
    """As the pipelines bridge them: what the network makes of a dot is no part of the depth."""
    training = dotted_scene.training.model_copy(update={"depth_weight": 1.0})
    scene = dotted_scene.model_copy(update={"training": training})
    rest, bridge = rest_depth_mm(scene.sensor), slope_bridge(dotted_data.background, scene)
    frames = whole_frames(dotted_data, skin_alone(dotted_data, scene), scene, rest)
    depth_mm = found_depth_mm(
        network, dotted_data.frames[INDEX], dotted_data, scene, rest_depth_mm=rest, bridge=bridge
    )
    error_px = (depth_mm - dotted_data.depth_mm[INDEX][:, 1:-1, 1:-1]) / scene.sensor.pitch_mm
    normals, slopes, at_rest = frames._found(network, INDEX)
    found = frames._depth_error(frames._depth(slopes, at_rest), INDEX).item()
    assert found == pytest.approx(np.square(error_px).mean(), rel=1e-4)
    assert frames.loss(network, INDEX) == frames._normals_loss(network, INDEX, normals) + found
    bare = scene.model_copy(update={"network": scene.network.model_copy(update={"bridge_dots": False})})
    without = replace(frames, scene=bare)
    bare_depth_px = without._depth(*without._found(network, INDEX)[1:])
    assert without._depth_error(bare_depth_px, INDEX).item() != pytest.approx(found)


def test_the_force_of_presses_that_the_weights_were_not_fitted_to(tiny_data, make_scene, network):
    """Weights follow from the model when `prepare` is called, not before."""
    scene = make_scene(**OF_SLOPES, training={"force_weight": 2.0})
    frames = whole_frames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))
    train, test = (tiny_data.indices(split) for split in ("train", "test"))
    frames.prepare(network)
    normals, slopes, at_rest = frames._found(network, test)
    features = frames._force.features(slopes - at_rest).detach().double().numpy()
    _, of_train, _ = frames._found(network, train)
    known = frames._force.features(of_train - at_rest).detach().double().numpy()
    force_n = tiny_data.forces_n(np.arange(len(tiny_data)), scene.force_axes)
    weights = ridge.solve(known, force_n[train], REGULARISATION)[0]
    expected = np.abs(features @ weights - force_n[test]).sum(axis=1).mean()
    found = frames.loss(network, test) - frames._normals_loss(network, test, normals)
    assert found.item() == pytest.approx(2 * expected, rel=1e-3)


def test_a_step_sees_some_rows_and_columns_where_no_depth_is_learned(
    tiny_data, make_scene, network, monkeypatch
):
    """One of four parts of the pixels, by chance; a model that is judged sees all of them."""
    monkeypatch.setattr(of_whole_frames, "SEEN_PX", 8)
    losses = {}
    for depth_weight in (0.0, 1.0):
        scene = make_scene(**OF_SLOPES, training={"force_weight": 2.0, "depth_weight": depth_weight})
        frames = whole_frames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))
        frames.prepare(network)
        torch.manual_seed(0)
        losses[depth_weight] = {frames.loss(network.train(), INDEX).item() for _ in range(30)}
        judged = frames.loss(network.eval(), INDEX).item()
        assert (judged in losses[depth_weight]) == bool(depth_weight)
    assert (len(losses[0.0]), len(losses[1.0])) == (4, 1)


@pytest.mark.parametrize("seen_px", [16, 8])
def test_weights_are_fitted_to_the_pixels_that_steps_see(
    tiny_data, make_scene, network, monkeypatch, seen_px
):
    monkeypatch.setattr(of_whole_frames, "SEEN_PX", seen_px)
    scene = make_scene(**OF_SLOPES, training={"force_weight": 2.0})
    frames = whole_frames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))
    frames.prepare(network)
    grid, train = every(16 // seen_px), tiny_data.indices("train")
    _, slopes, at_rest = frames._found(network, train, grid)
    found = frames._force.weights.clone()
    frames._force.refit(frames._force.features((slopes - at_rest).detach(), grid))
    torch.testing.assert_close(frames._force.weights, found)


def test_a_force_needs_no_depth(tiny_data, make_scene, network):
    scene = make_scene(**OF_SLOPES, training={"force_weight": 1.0, "input_noise": 0.1})
    valid = np.ones(tiny_data.frames.shape[:3], bool)
    valid[:, :3] = False
    data = replace(tiny_data, depth_mm=None, valid=valid)
    frames = whole_frames(data, data, scene, rest_depth_mm(scene.sensor))
    assert type(frames) is PartlyLabelled
    frames.prepare(network)
    assert np.isfinite(frames.loss(network.train(), INDEX).item())


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


@pytest.mark.parametrize(
    ("changes", "lack"),
    [
        ({"depth_mm": None}, "depth_mm: missing, and training.depth_weight needs"),
        ({"valid": False}, "valid: not every pixel is, and training.depth_weight needs"),
    ],
)
def test_unknown_depth_is_refused(tiny_data, make_scene, tmp_path, changes, lack):
    if "valid" in changes:
        changes = {"valid": np.ones(tiny_data.frames.shape[:3], bool)}
        changes["valid"][3, 5, 7] = False
    scene, path = make_scene(training={"depth_weight": 1.0}), tmp_path / "frames.h5"
    require(tiny_data, scene, path)
    with pytest.raises(TrainingError, match=f"frames.h5: {lack}"):
        require(replace(tiny_data, **changes), scene, path)


def test_contact_circles_of_balls_are_enough(pressed):
    assert unknown_depth(pressed) is None
    without = {name: values for name, values in pressed.indenter.items() if name != "ball_mm"}
    assert unknown_depth(replace(pressed, indenter=without)).startswith("depth_mm: missing")
    nowhere = pressed.indenter | {"radius_px": np.full(len(pressed), np.nan)}
    assert unknown_depth(replace(pressed, indenter=nowhere)).startswith("depth_mm: missing")
