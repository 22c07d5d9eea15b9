"""Optimisers of the training on whole frames, by their names in a scene."""

from collections.abc import Iterable

import torch

SOAP_BETAS = (0.9, 0.99)
"""Of SOAP's moments, as Adam's here have 0.9 and 0.999: a training has a few thousand steps."""
SOAP_STEPS = 5
"""Steps between two updates of SOAP's axes: with a dozen rows and columns they cost little."""


def optimiser_of(name: str, parameters: Iterable[torch.nn.Parameter], rate: float) -> torch.optim.Optimizer:
    """That of a scene's `training.depth_optimiser`, with a learning rate, without weight decay.

    adam : AdamW; soap : Adam in the axes of Shampoo, in which the steps of a layer's weights hardly depend on
    each other. Source: Vyas et al., "SOAP", arXiv:2409.11321.
    """
    if name == "soap":
        from pytorch_optimizer import SOAP  # takes half a second, which others need not wait for

        return SOAP(
            parameters,
            lr=rate,
            betas=SOAP_BETAS,
            weight_decay=0.0,
            precondition_frequency=SOAP_STEPS,
        )
    return torch.optim.AdamW(parameters, lr=rate, weight_decay=0.0, fused=True)
