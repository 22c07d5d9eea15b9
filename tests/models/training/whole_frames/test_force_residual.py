"""The force's errors as a function of the network's parameters, and their derivatives, frame by frame."""

import numpy as np
import pytest
import torch

from fastac.models.floating.threads import single_thread
from fastac.models.training.force import ridge
from fastac.models.training.whole_frames import force_residual
from fastac.models.training.whole_frames.force_residual import FIRST_LENGTH, PARTS, ForceResidual, solve
from fastac.models.training.whole_frames.held_out_force import REGULARISATION


def test_errors_are_those_of_the_best_weights(residual):
    frames, index = residual.frames, residual.index
    _, slopes, at_rest = frames._found(residual.network, index)
    features = frames.of_slopes(slopes - at_rest).detach().double().numpy()
    features = ridge.joined(features, frames.dot_shifts_px(index))
    force_n = frames.data.forces_n(index, (0, 1, 2))
    weights = ridge.solve(features, force_n, REGULARISATION)[0]
    expected = features @ weights - force_n
    assert residual.error_n(residual.parameters) == pytest.approx(expected.ravel(), rel=1e-4, abs=1e-7)
    test = frames.data.indices("test")
    _, slopes, _ = frames._found(residual.network, test)
    found = frames.of_slopes(slopes - at_rest).detach().double().numpy()
    found = ridge.joined(found, frames.dot_shifts_px(test)) @ weights
    elsewhere = residual.error_elsewhere_n(residual.parameters, test)
    assert elsewhere == pytest.approx(found - frames.data.forces_n(test, (0, 1, 2)), rel=1e-4, abs=1e-7)


def test_derivatives_are_those_of_each_force_less_what_weights_make_up_for(residual):
    """Each force's gradient by itself, and a ridge fit to them."""
    frames, network, start = residual.frames, residual.network, residual.parameters
    features, weights = residual.fitted(start)
    fixed, expected = torch.from_numpy(weights[: frames.of_slopes.count]).float(), []
    for sample in residual.index:
        _, slopes, at_rest = frames._found(network, np.array([sample]))
        force_n = (frames.of_slopes(slopes - at_rest) @ fixed)[0]
        for value in force_n:
            gradients = torch.autograd.grad(value, network.parameters(), retain_graph=True)
            expected.append(torch.cat([values.flatten() for values in gradients]).numpy())
    expected = np.stack(expected).reshape(len(residual.index), 3, -1)
    for axis in range(3):
        of_axis = expected[:, axis].astype(np.float64)
        expected[:, axis] = of_axis - features @ ridge.solve(features, of_axis, REGULARISATION)[0]
    found = residual.jacobian(start)
    assert np.abs(found).max() > 1e-3
    assert found == pytest.approx(expected.reshape(found.shape), rel=1e-3, abs=1e-4 * np.abs(found).max())


def test_each_further_call_renews_a_part_of_the_pixels(residual):
    """Of as many calls the last finds what another, which has never seen the start, finds at once."""
    start = residual.parameters
    moved = start + 0.1 * np.random.default_rng(0).standard_normal(len(start))
    before = residual.jacobian(start)
    found = [residual.jacobian(moved) for _ in range(PARTS)]
    whole = ForceResidual(residual.frames, residual.network, residual.index).jacobian(moved)
    errors = [np.abs(derivatives - whole).max() for derivatives in [before, *found]]
    assert errors[-1] < 1e-6 * np.abs(whole).max()
    assert min(errors[:-1]) > 1e-2 * np.abs(whole).max()


@single_thread()
def test_threads_find_the_same(residual, monkeypatch):
    monkeypatch.setattr(force_residual, "FRAMES_AT_A_TIME", 5)
    found = []
    for threads in (1, 3):
        residual.threads, residual._known, residual._latest = threads, None, {}
        found.append((residual.error_n(residual.parameters), residual.jacobian(residual.parameters)))
    for one, other in zip(*found, strict=True):
        assert np.array_equal(one, other)


def test_the_first_step_is_as_long_as_it_may_be_and_later_ones_are_not_too_long(residual, monkeypatch):
    """Parameters of a neuron that no pixel activates stay where they are."""
    start, tried = residual.parameters, []
    first = residual.network.linear_layers[0].weight.numel()
    start[first] = -100.0  # the first neuron's bias

    def watched(self, parameters):
        tried.append(parameters - start)
        return error_n(self, parameters)

    error_n = ForceResidual.error_n
    monkeypatch.setattr(ForceResidual, "error_n", watched)
    found = solve(residual, start, 6, lambda: None)
    lengths = [np.linalg.norm(step) for step in tried]
    assert lengths[:2] == pytest.approx([0, FIRST_LENGTH], rel=1e-3)
    assert max(lengths) < 10 * FIRST_LENGTH
    inputs = residual.network.linear_layers[0].in_features
    assert found[:inputs] == pytest.approx(start[:inputs], rel=1e-9)
    assert found[first] == pytest.approx(-100, rel=1e-9)
    assert np.abs(found - start).max() > 1e-3


@pytest.mark.parametrize("residual", ["skin"], indirect=True)  # dots' weights leave these few no error
def test_lowered_errors_are_told_and_the_lowest_is_found(residual):
    start, told, steps = residual.parameters, [], []
    found = solve(residual, start, 20, lambda: steps.append(1), told.append)
    errors = [np.linalg.norm(residual.error_n(parameters)) for parameters in (start, *told)]
    assert len(told) >= 2
    assert len(told) < len(steps) <= 20
    assert (np.diff(errors) < 0).all()
    assert np.array_equal(found, told[-1])
