"""The loop over epochs that all trainings share: their steps, learning curve, progress and kept epoch."""

from collections.abc import Callable, Iterable, Sequence

import torch

from fastac.models.training.best_epoch import BestEpoch
from fastac.store.progress import progress_bar


def descend(loss: torch.Tensor, optimiser: torch.optim.Optimizer, schedule) -> float:
    """A step of an optimiser and of its schedule of rates down the gradient of `loss`; returns the loss."""
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    optimiser.step()
    schedule.step()
    return loss.item()


def train_epochs(
    model: torch.nn.Module,
    epochs: int,
    steps: int,
    batches: Callable[[], Iterable[Sequence[int]]],
    step: Callable[[Sequence[int]], float],
    *,
    label: str,
    best: BestEpoch,
    error: Callable[[], float] | None = None,
    judged: torch.nn.Module | None = None,
    quantity: str = "loss",
    progress: bool = False,
) -> list[dict]:
    """Train `model` for so many epochs of `steps` steps, or until `best` is done; returns the learning curve.

    batches : draws an epoch's batches of indices; step : trains on one, returns its mean loss or error
    label : of the progress bar; quantity : what is averaged, as in the keys `train_…` and `validation_…` of
        the curve; in N where it ends in _n
    error : that on the validation split, after an epoch; the model ends with the parameters of the smallest,
        or of those that `best` was told before. None: with the last
    judged : whose error that is; None: that of `model` itself
    """
    history: list[dict] = []
    name, unit = ("mae", " N") if quantity.endswith("_n") else (quantity, "")
    bar = progress_bar(total=epochs * steps, desc=label, unit="step", enabled=progress)
    for epoch in range(epochs):
        total, count = 0.0, 0
        for index in batches():
            total += step(index) * len(index)
            count += len(index)
            bar.update()
        entry = {"epoch": epoch + 1, f"train_{quantity}": total / count}
        shown = entry[f"train_{quantity}"]
        if error is not None:
            shown = entry[f"validation_{quantity}"] = error()
            best.tell(shown, model if judged is None else judged)
        history.append(entry)
        bar.set_postfix({name: f"{shown:.4f}{unit}"})
        if best.done:
            break
    bar.close()
    best.restore(model)
    return history
