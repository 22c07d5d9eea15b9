import pytest
import torch

from fastac.models.training.best_epoch import BestEpoch


def model_of(value: float) -> torch.nn.Module:
    model = torch.nn.Linear(1, 1)
    torch.nn.init.constant_(model.weight, value)
    return model


def told(errors: list[float], patience: int | None) -> tuple[BestEpoch, int]:
    """What is kept of epochs with these errors, whose models carry their numbers, and how many there were."""
    best = BestEpoch(patience)
    for epoch, error in enumerate(errors):
        best.tell(error, model_of(epoch))
        if best.done:
            return best, epoch + 1
    return best, len(errors)


@pytest.mark.parametrize(
    ("patience", "epochs", "kept"), [(None, 7, 6), (1, 3, 1), (2, 6, 3), (3, 7, 6), (9, 7, 6)]
)
def test_training_ends_after_so_many_epochs_that_are_no_better(patience, epochs, kept):
    """An error that only equals the smallest is no better."""
    best, count = told([5.0, 3.0, 3.0, 2.0, 4.0, 2.0, 1.0], patience)
    assert count == epochs
    model = model_of(-1)
    best.restore(model)
    assert model.weight.item() == kept


def test_what_is_kept_does_not_change_with_the_model():
    best, model = BestEpoch(), model_of(1)
    best.tell(1.0, model)
    torch.nn.init.constant_(model.weight, 2)
    best.restore(model)
    assert model.weight.item() == 1


def test_without_a_validation_error_nothing_ends_and_nothing_is_restored():
    best, model = BestEpoch(1), model_of(3)
    best.restore(model)
    assert not best.done
    assert model.weight.item() == 3
