"""The loop over epochs, on a model of one parameter."""

from unittest.mock import MagicMock

import pytest
import torch

from fastac.models.training import epochs
from fastac.models.training.best_epoch import BestEpoch
from fastac.models.training.epochs import descend, train_epochs


def batches() -> list[list[int]]:
    """Three samples in steps of two."""
    return [[0, 1], [2]]


@pytest.fixture
def model() -> torch.nn.Linear:
    found = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.ones_(found.weight)
    return found


def halved(model: torch.nn.Linear):
    """A step that halves the parameter; returns the index of its first sample as the loss."""

    def step(index: list[int]) -> float:
        with torch.no_grad():
            model.weight /= 2
        return float(index[0])

    return step


def test_a_step_goes_down_the_gradient_and_the_schedule_with_it(model):
    optimiser = torch.optim.SGD(model.parameters(), lr=0.25)
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimiser, 0.5)
    for expected in (1 - 0.25 * 2, 0.5 - 0.125 * 1):
        loss = model.weight.square().sum()
        assert descend(loss, optimiser, schedule) == loss.item()
        assert model.weight.item() == expected


def test_an_epoch_s_error_is_the_mean_over_its_samples(model):
    history = train_epochs(model, 2, 2, batches, halved(model), label="test", best=BestEpoch())
    assert history == [{"epoch": k, "train_loss": pytest.approx(2 / 3)} for k in (1, 2)]
    assert model.weight.item() == 1 / 16


def test_the_best_epoch_is_kept_and_patience_ends_the_training(model):
    errors = iter([0.3, 0.2, 0.4, 0.5, 0.1])
    history = train_epochs(
        model,
        5,
        2,
        batches,
        halved(model),
        label="test",
        best=BestEpoch(patience=2),
        error=lambda: next(errors),
        quantity="mae_n",
    )
    assert [entry["validation_mae_n"] for entry in history] == [0.3, 0.2, 0.4, 0.5]
    assert set(history[0]) == {"epoch", "train_mae_n", "validation_mae_n"}
    assert model.weight.item() == 1 / 16  # of the second epoch


def test_what_was_told_before_counts_too(model):
    best = BestEpoch()
    best.tell(0.1, model)
    train_epochs(model, 2, 2, batches, halved(model), label="test", best=best, error=lambda: 0.2)
    assert model.weight.item() == 1


def test_the_parameters_are_those_of_the_model_that_is_judged(model):
    average = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.constant_(average.weight, 7.0)
    train_epochs(
        model,
        1,
        2,
        batches,
        halved(model),
        label="test",
        best=BestEpoch(),
        error=lambda: 0.2,
        judged=average,
    )
    assert model.weight.item() == 7


@pytest.mark.parametrize(
    ("quantity", "shown"), [("mae_n", {"mae": "0.6667 N"}), ("loss", {"loss": "0.6667"})]
)
def test_progress_counts_steps_and_says_what_is_shown_in_its_unit(model, monkeypatch, quantity, shown):
    bar = MagicMock()
    monkeypatch.setattr(epochs, "progress_bar", bar)
    train_epochs(
        model, 3, 2, batches, halved(model), label="test", best=BestEpoch(), quantity=quantity, progress=True
    )
    bar.assert_called_once_with(total=6, desc="test", unit="step", enabled=True)
    assert bar.return_value.update.call_count == 6
    bar.return_value.set_postfix.assert_called_with(shown)
    bar.return_value.close.assert_called_once_with()
