import pytest
import torch

from fastac.models.training.whole_frames.optimisers import optimiser_of


def losses(name: str, turned: bool) -> list[float]:
    """Of a descent in a valley that is ten times as long as wide, along the axes of the weights or turned
    against them, from the same place in it."""
    generator = torch.Generator().manual_seed(1)
    turn, _ = torch.linalg.qr(torch.randn(3, 3, generator=generator))
    begin, target = torch.randn(2, 3, 3, generator=generator)
    turn = turn if turned else torch.eye(3)
    weight = torch.nn.Parameter(turn.T @ begin)
    bias = torch.nn.Parameter(torch.ones(3))
    optimiser = optimiser_of(name, [weight, bias], 0.05)
    found = []
    for _ in range(100):
        optimiser.zero_grad()
        error = torch.tensor([10.0, 3.0, 1.0])[:, None] * (turn @ weight - target)
        loss = error.square().mean() + bias.square().mean()
        loss.backward()
        optimiser.step()
        found.append(loss.item())
    return found


@pytest.mark.parametrize("name", ["adam", "soap"])
def test_descends(name):
    found = losses(name, turned=True)
    assert found[-1] < 0.2 * found[0]


def test_soap_does_not_mind_how_a_valley_lies_and_adam_does():
    assert losses("soap", True) == pytest.approx(losses("soap", False), rel=0.02)
    assert losses("adam", True) != pytest.approx(losses("adam", False), rel=0.02)
