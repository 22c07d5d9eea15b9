"""The best of some parameters of the pixel network that least squares on the force may start from.

Least squares end in a minimum that depends on the start, and one of ten is markedly poorer than the others.
A dozen steps on half of the presses, or on enough of them, tell by the error on others which starts are good.
"""

import numpy as np

from fastac.models.training.whole_frames.force_residual import ForceResidual, solve
from fastac.store.progress import progress_bar

STEPS = 12
"""Of least squares, after which starts are compared."""
PRESSES = 1600
"""That starts learn from at most, and as many that judge them."""
SPREAD = 0.05
"""Relative standard deviation of the parameters of further starts. With 0.2 many take long to recover."""


def set_best(residual: ForceResidual, *, progress: bool) -> None:
    """Give the network the best parameters found from the scene's `training.force_starts`, by `STEPS` of
    least squares from each.

    Starts are the network's own parameters, and others that differ from them by chance.
    residual : of the frames to learn from; the starts learn from one half of them, the other half judges, or
        `PRESSES` of each
    """
    settings = residual.frames.scene.training
    rng = np.random.default_rng(settings.seed)
    halves = np.array_split(rng.permutation(residual.index), 2)
    learned, judging = (np.sort(half[:PRESSES]) for half in halves)
    own, count = residual.parameters, settings.force_starts
    bar = progress_bar(total=count * STEPS, desc="force, starts", unit="step", enabled=progress)
    found, errors_n = [], []
    with bar:
        for start in range(count):
            changed = 1 + SPREAD * rng.standard_normal(len(own)) * (start > 0)
            some = residual.of(learned)
            found.append(solve(some, own * changed, STEPS, bar.update))
            errors_n.append(np.abs(some.error_elsewhere_n(found[-1], judging)).sum(axis=1).mean())
            bar.set_postfix({"mae": f"{min(errors_n):.4f} N"})
    residual.set(found[int(np.argmin(errors_n))])
