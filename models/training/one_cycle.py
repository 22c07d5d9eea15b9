"""Learning rates that rise and are annealed again over a training of known length."""

import torch

SHORT = 10
"""Steps up to which a tenth of a training is too short a warm-up: OneCycleLR divides by its length less
one."""


def one_cycle(
    optimiser: torch.optim.Optimizer, rates: float | list[float], steps: int
) -> torch.optim.lr_scheduler.OneCycleLR:
    """One cycle over so many steps, a tenth of which warms up.

    rates : the largest, for all groups of parameters or for each
    Source: Smith, Topin, "Super-Convergence", 2018.
    """
    warm_up = 0.1 if steps > SHORT else 0.05
    return torch.optim.lr_scheduler.OneCycleLR(optimiser, rates, total_steps=steps, pct_start=warm_up)
