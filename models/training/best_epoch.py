"""Which epoch of a training is kept, and when there is no use in going on: the validation error decides."""

import copy

import numpy as np
import torch


class BestEpoch:
    """The parameters of the smallest validation error so far.

    patience : how many epochs in a row without a smaller error end the training; None: no number does
    Source: Prechelt, "Early Stopping - But When?", in "Neural Networks: Tricks of the Trade", 1998.
    """

    def __init__(self, patience: int | None = None):
        self.patience, self.error, self._waited = patience, np.inf, 0
        self._state: dict[str, torch.Tensor] | None = None

    def tell(self, error: float, model: torch.nn.Module) -> None:
        """An epoch's validation error and the model that has it."""
        self._waited += 1
        if error < self.error:
            self.error, self._waited = error, 0
            self._state = copy.deepcopy(model.state_dict())

    @property
    def done(self) -> bool:
        """Whether the patience is at its end."""
        return self.patience is not None and self._waited >= self.patience

    def restore(self, model: torch.nn.Module) -> None:
        """Give the model the best parameters; where no epoch was told, it keeps its own."""
        if self._state is not None:
            model.load_state_dict(self._state)
