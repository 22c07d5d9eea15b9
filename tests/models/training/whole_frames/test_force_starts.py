"""Of several starts of least squares on the force the one that is best on held-out presses goes on."""

import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.whole_frames import force_features, force_starts
from fastac.models.training.whole_frames.force_residual import ForceResidual
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.sensor.geometry import rest_depth_mm


@pytest.fixture
def frames(make_scene, of_slopes, tiny_data, monkeypatch) -> WholeFrames:
    """Few presses for few features and a small network."""
    monkeypatch.setattr(force_features, "SLOPES_SIZE", 1)
    monkeypatch.setattr(force_starts, "STEPS", 4)
    scene = make_scene(**of_slopes, training={"force_starts": 3, "force_steps": 2})
    return WholeFrames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))


def start(inputs: int) -> PixelNetwork:
    torch.manual_seed(3)
    return PixelNetwork(inputs, (2,))


def test_the_best_on_the_other_half_is_set(frames, tiny_data, monkeypatch):
    """Each start learns from the same half; whichever is told to be best on the other half is set."""
    index, inputs = frames.index("train"), tiny_data.frames.shape[-1] + 2
    ends, halves, judged = [], [], []
    solve, elsewhere = force_starts.solve, ForceResidual.error_elsewhere_n

    def watched(residual, parameters, steps, tried):
        halves.append(residual.index)
        ends.append((parameters, solve(residual, parameters, steps, tried)))
        return ends[-1][1]

    def told(residual, parameters, others):
        judged.append(others)
        error = elsewhere(residual, parameters, others)
        return error * (0.01 if len(judged) == best + 1 else 1)

    monkeypatch.setattr(force_starts, "solve", watched)
    monkeypatch.setattr(ForceResidual, "error_elsewhere_n", told)
    for best in range(3):
        network = start(inputs)
        own = torch.nn.utils.parameters_to_vector(network.parameters()).detach().numpy()
        for seen in (ends, halves, judged):
            seen.clear()
        force_starts.set_best(ForceResidual(frames, network, index), progress=False)
        np.testing.assert_array_equal(ends[0][0], own.astype(float))
        for parameters, _ in ends[1:]:
            spread = (parameters[own != 0] / own[own != 0]).std()
            assert 0.5 * force_starts.SPREAD < spread < 2 * force_starts.SPREAD
        found = torch.nn.utils.parameters_to_vector(network.parameters()).detach().numpy()
        np.testing.assert_array_equal(found, ends[best][1].astype(np.float32))
        for half, others in zip(halves, judged, strict=True):
            np.testing.assert_array_equal(half, halves[0])
            np.testing.assert_array_equal(np.sort(np.concatenate([half, others])), np.sort(index))
            assert abs(len(half) - len(others)) <= 1


def test_the_same_seed_leads_to_the_same_network(frames, tiny_data):
    found = []
    for _ in range(2):
        network = start(tiny_data.frames.shape[-1] + 2)
        force_starts.set_best(ForceResidual(frames, network, frames.index("train")), progress=False)
        found.append(torch.nn.utils.parameters_to_vector(network.parameters()))
    assert torch.equal(*found)


@pytest.mark.parametrize("presses", [3, 5])
def test_no_more_presses_are_learned_from_than_it_takes(frames, tiny_data, monkeypatch, presses):
    seen = []

    def watched(residual, parameters, steps, tried):
        seen.append(residual.index)
        return parameters

    def told(residual, parameters, others):
        seen.append(others)
        return np.ones((len(others), 3))

    monkeypatch.setattr(force_starts, "PRESSES", presses)
    monkeypatch.setattr(force_starts, "solve", watched)
    monkeypatch.setattr(ForceResidual, "error_elsewhere_n", told)
    network = start(tiny_data.frames.shape[-1] + 2)
    force_starts.set_best(ForceResidual(frames, network, frames.index("train")), progress=False)
    assert [len(index) for index in seen] == [presses] * 6
    assert len(np.union1d(*seen[:2])) == 2 * presses
