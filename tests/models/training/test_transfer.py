import copy

import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork, predict
from fastac.models.training import transfer
from fastac.models.training.labelled_pixels import training_pixels
from fastac.models.training.pruning.hidden_neurons import widths
from fastac.models.training.pruning.prune import gradient_error
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.models.training.whole_frames.network_depth import depth_mae_mm
from fastac.scenes.training_schema import Training
from fastac.sensor.geometry import rest_depth_mm

SETTINGS = Training(normals_batch_px=64)


@pytest.fixture
def network() -> PixelNetwork:
    torch.manual_seed(1)
    return PixelNetwork(6, (5, 4))


@pytest.fixture
def pixels() -> np.ndarray:
    """Features (256, 6)."""
    return np.random.default_rng(1).integers(-100, 100, (256, 6))


def unit(normals: np.ndarray) -> np.ndarray:
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def test_gains_are_multiplied_into_the_first_layer(network):
    tuned = transfer.InputGains(network)
    with torch.no_grad():
        tuned.gain.copy_(torch.tensor([0.5, 1.0, 2.0, 1.5]))
        tuned.offset.copy_(torch.tensor([0.1, -0.2, 0.0, 0.3]))
        x = torch.rand(20, 6)
        before = tuned(x)
        torch.testing.assert_close(tuned.folded()(x), before)


@pytest.mark.parametrize("what", transfer.TUNES)
def test_only_what_is_tuned_changes(network, pixels, monkeypatch, what):
    monkeypatch.setattr(transfer, "STEPS", 8)
    before = copy.deepcopy(network)
    y = unit(predict(network, pixels) + np.array([0.2, -0.1, 0]))
    tuned, history = transfer.tune(network, pixels, y, SETTINGS, what)
    assert len(history) == 2  # of four steps each
    changed = [
        not torch.equal(new.weight, old.weight)
        for new, old in zip(tuned.linear_layers, before.linear_layers, strict=True)
    ]
    assert changed == {"gains": [True, False, False], "last": [False, False, True], "all": [True] * 3}[what]
    coordinates = [layer.weight[:, 4:] for layer in (tuned.linear_layers[0], before.linear_layers[0])]
    assert torch.equal(*coordinates) == (what != "all")
    assert all(parameter.requires_grad for parameter in tuned.parameters())


def test_gains_of_another_camera_are_found(network, pixels, monkeypatch):
    """A unit whose channels answer 1.3, 0.8, 1 and 0.9 times as strongly."""
    monkeypatch.setattr(transfer, "STEPS", 400)
    gains = np.array([1.3, 0.8, 1.0, 0.9, 1, 1])
    y = unit(predict(network, pixels / gains))
    before = gradient_error(network, pixels, y, 4)
    tuned, _ = transfer.tune(network, pixels, y, SETTINGS, "gains")
    assert gradient_error(tuned, pixels, y, 4) < 0.1 * before


def test_a_network_no_wider_than_the_hardware(network, pixels):
    y = unit(predict(network, pixels))
    found = transfer.narrowed(network, pixels, y, (4, 4), 4)
    assert widths(found) == (4, 4)
    assert transfer.narrowed(network, pixels, y, (7, 4), 4) is network


def test_contacts_elsewhere(pixels):
    found = transfer.at_other_places(pixels, seed=1)
    np.testing.assert_array_equal(found[:256], pixels)
    np.testing.assert_array_equal(found[256:, :4], pixels[:, :4])
    assert (found[256:, 4:] != pixels[:, 4:]).any()
    assert sorted(map(tuple, found[256:, 4:])) == sorted(map(tuple, pixels[:, 4:]))


def test_a_network_learns_from_the_depth_again(tiny_data, make_scene, monkeypatch):
    """And changes what is tuned only."""
    monkeypatch.setattr(transfer, "STEPS", 40)
    monkeypatch.setattr(transfer, "DEPTH_STEPS", 100)
    scene = make_scene(training={"depth_weight": 10.0})
    torch.manual_seed(1)
    begun, rest = PixelNetwork(6, (8, 8)), rest_depth_mm(scene.sensor)
    x, y = training_pixels(tiny_data, scene.training)
    errors = {}
    for pressed in (None, WholeFrames(tiny_data, tiny_data, scene, rest)):
        network, _ = transfer.tune(copy.deepcopy(begun), x, y, scene.training, "last", pressed=pressed)
        assert torch.equal(network.linear_layers[0].weight, begun.linear_layers[0].weight)
        test = tiny_data.indices("test")
        errors[pressed is None] = depth_mae_mm(network, tiny_data, scene, test, rest_depth_mm=rest)
    assert errors[False] < 0.9 * errors[True]
