"""The loss of normals, depth and force of frames of which the whole skin is known."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.flow.training import skin_alone
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.network import predict
from fastac.models.integer.features import integer_features
from fastac.models.training.force import ridge
from fastac.models.training.normals import normal_loss
from fastac.models.training.whole_frames import frames as of_whole_frames
from fastac.models.training.whole_frames.force_features import OfDisplacement
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.models.training.whole_frames.held_out_force import REGULARISATION
from fastac.models.training.whole_frames.network_depth import found_depth_mm
from fastac.models.training.whole_frames.pixel_grid import every
from fastac.models.training.whole_frames.usable_frames import whole_frames
from fastac.models.vision.dots import slope_bridge
from fastac.sensor.geometry import rest_depth_mm

INDEX = np.array([0, 3])


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


def test_the_force_of_presses_that_the_weights_were_not_fitted_to(tiny_data, make_scene, network, of_slopes):
    """Weights follow from the model when `prepare` is called, not before."""
    scene = make_scene(**of_slopes, training={"force_weight": 2.0})
    frames = whole_frames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))
    train, test = (tiny_data.indices(split) for split in ("train", "test"))
    frames.prepare(network)
    normals, slopes, at_rest = frames._found(network, test)
    features = frames.of_slopes(slopes - at_rest).detach().double().numpy()
    _, of_train, _ = frames._found(network, train)
    known = frames.of_slopes(of_train - at_rest).detach().double().numpy()
    force_n = tiny_data.forces_n(np.arange(len(tiny_data)), scene.force_axes)
    weights = ridge.solve(known, force_n[train], REGULARISATION)[0]
    expected = np.abs(features @ weights - force_n[test]).sum(axis=1).mean()
    found = frames.loss(network, test) - frames._normals_loss(network, test, normals)
    assert found.item() == pytest.approx(2 * expected, rel=1e-3)


def test_dots_shift_as_the_hardware_finds_them(dotted_data, dotted_bundle, dotted_scene):
    """In pixels, where the force follows from them too."""
    rest = rest_depth_mm(dotted_scene.sensor)
    frames = whole_frames(dotted_data, dotted_data, dotted_scene, rest)
    found = Emulator(dotted_bundle.pipeline).run(dotted_data.frames[INDEX], wanted=["dot_shifts_px"])
    assert np.array_equal(frames.dot_shifts_px(INDEX), found.dot_shifts_px)
    assert np.abs(found.dot_shifts_px).max() > 0
    force = dotted_scene.force.model_copy(update={"dots": False})
    without = replace(frames, scene=dotted_scene.model_copy(update={"force": force}))
    assert without.dot_shifts_px(INDEX) is None


@pytest.mark.parametrize("clamp", [True, False])
@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_the_force_of_the_displacement(tiny_data, make_scene, network, mode, clamp):
    """By weights that were fitted to other presses, of what the network's depth lies below its rest."""
    force, training = {"clamp": clamp, "kernel_size": 3}, {"force_weight": 2.0}
    scene = make_scene(outputs=["force_z"], poisson={"mode": mode}, force=force, training=training)
    rest = rest_depth_mm(scene.sensor)
    frames = whole_frames(tiny_data, tiny_data, scene, rest)
    train, test = (tiny_data.indices(split) for split in ("train", "test"))
    frames.prepare(network)

    def features(index: np.ndarray) -> np.ndarray:
        at_rest, depth_mm = (
            found_depth_mm(network, images, tiny_data, scene, rest_depth_mm=rest)
            for images in (tiny_data.background[None], tiny_data.frames[index])
        )
        displacement = torch.from_numpy((at_rest - depth_mm) / scene.sensor.pitch_mm).float()
        return OfDisplacement(14, 3, clamp=clamp)(displacement).double().numpy()

    force_n = tiny_data.forces_n(np.arange(len(tiny_data)), scene.force_axes)
    weights = ridge.solve(features(train), force_n[train], REGULARISATION)[0]
    expected = np.abs(features(test) @ weights - force_n[test]).sum(axis=1).mean()
    found = frames.loss(network, test) - frames._normals_loss(network, test, frames._found(network, test)[0])
    assert found.item() == pytest.approx(2 * expected, rel=1e-2)


def test_a_step_sees_some_rows_and_columns_where_no_depth_is_learned(
    tiny_data, make_scene, network, of_slopes, monkeypatch
):
    """One of four parts of the pixels, by chance; a model that is judged sees all of them."""
    monkeypatch.setattr(of_whole_frames, "SEEN_PX", 8)
    losses = {}
    for depth_weight in (0.0, 1.0):
        scene = make_scene(**of_slopes, training={"force_weight": 2.0, "depth_weight": depth_weight})
        frames = whole_frames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))
        frames.prepare(network)
        torch.manual_seed(0)
        losses[depth_weight] = {frames.loss(network.train(), INDEX).item() for _ in range(30)}
        judged = frames.loss(network.eval(), INDEX).item()
        assert (judged in losses[depth_weight]) == bool(depth_weight)
    assert (len(losses[0.0]), len(losses[1.0])) == (4, 1)


@pytest.mark.parametrize("seen_px", [16, 8])
def test_weights_are_fitted_to_the_pixels_that_steps_see(
    tiny_data, make_scene, network, of_slopes, monkeypatch, seen_px
):
    monkeypatch.setattr(of_whole_frames, "SEEN_PX", seen_px)
    scene = make_scene(**of_slopes, training={"force_weight": 2.0})
    frames = whole_frames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))
    frames.prepare(network)
    grid, train = every(16 // seen_px), tiny_data.indices("train")
    _, slopes, at_rest = frames._found(network, train, grid)
    found = frames._force.weights.clone()
    frames._force.refit(frames.of_slopes((slopes - at_rest).detach(), grid))
    torch.testing.assert_close(frames._force.weights, found)
