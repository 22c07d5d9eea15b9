"""Training of the pixel network for a force that is a sum of its slopes, by nonlinear least squares.

An elastic layer's force is not linear in the slopes, so the network bends them until it is. It has a few
hundred parameters: few enough to take the exact derivatives of every press's force and solve for all of them
together, which in a dozen steps leaves six tenths of the error that thousands of gradient steps leave.
Nothing is left of the normals, which may be any whose sum is the force. One start may lead to a poorer
minimum than another: several can be compared (force_starts.py), or a few presses at a time come before all at
once (force_filter.py).
"""

import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.threads import single_thread
from fastac.models.training.whole_frames import force_starts
from fastac.models.training.whole_frames.force_filter import UPDATES, ForceFilter, learn
from fastac.models.training.whole_frames.force_residual import ForceResidual, solve
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.store.progress import progress_bar

LABEL, PASSES_LABEL = "force, least squares", "force, a few presses at a time"


def train(network: PixelNetwork, frames: WholeFrames, *, progress: bool = False) -> list[dict]:
    """Train the float network on for the scene's `training.force_steps`; it is changed itself.

    It learns from the train split; first, with `training.force_passes`, from a few presses at a time. Returns
    the learning curve: of each pass, and of each step that lowered the error, the mean absolute error in N,
    summed over the axes, of the train and, if there is one, the validation split; of a pass those of presses
    each before it was learned from. The network keeps the last parameters but where the validation error
    tells that those of an earlier step were better (`chosen`).
    Raises ValueError where the frames are too few for the network.
    """
    index, validation = frames.index("train"), frames.index("validation")
    settings = frames.scene.training
    steps, starts, passes = settings.force_steps, settings.force_starts, settings.force_passes
    residual = ForceResidual(frames, network, index)
    axes = len(frames.scene.force_axes)
    searched, forces = len(residual.parameters) + frames.of_slopes.count * axes, len(index) * axes
    if forces < searched:
        raise ValueError(
            f"split: the train split has {forces} forces for {searched} parameters of the network and weights"
            " of the force; training.force_steps needs more, 0 does without"
        )
    if starts > 1 and len(index) // 2 * axes < searched:
        raise ValueError(
            f"split: half of the train split has {len(index) // 2 * axes} forces for {searched} parameters of"
            " the network and weights of the force; training.force_starts needs more, 1 does without"
        )
    history: list[dict] = []
    found, errors_n = [], []
    bar = progress_bar(total=steps, desc=LABEL, unit="step", enabled=progress)
    pass_bar = progress_bar(
        total=passes * UPDATES, desc=PASSES_LABEL, unit="step", enabled=progress and passes > 0
    )

    def entry(train_mae_n: float, elsewhere_n: np.ndarray | None, shown: tqdm) -> None:
        """elsewhere_n : absolute errors of the validation split, (frames,), if there is one"""
        known = {"epoch": len(history), "train_mae_n": float(train_mae_n)}
        if elsewhere_n is not None:
            known["validation_mae_n"] = float(elsewhere_n.mean())
        history.append(known)
        shown.set_postfix({"mae": f"{train_mae_n:.4f} N"})

    def keep_pass(state: ForceFilter, train_mae_n: float) -> None:
        elsewhere_n = np.abs(state.errors_n(validation)).sum(axis=1) if len(validation) else None
        entry(train_mae_n, elsewhere_n, pass_bar)

    def keep(parameters: np.ndarray) -> None:
        train_n = np.abs(residual.error_n(parameters)).sum() / len(index)
        if len(validation):
            errors_n.append(np.abs(residual.error_elsewhere_n(parameters, validation)).sum(axis=1))
        entry(train_n, errors_n[-1] if errors_n else None, bar)
        found.append(parameters.copy())

    # Sums have the same order on every machine, and products this small are faster on one thread.
    with single_thread(), threadpool_limits(1):
        if starts > 1:
            force_starts.set_best(residual, progress=progress)
        if passes:
            with pass_bar:
                residual.set(learn(residual, passes, pass_bar.update, keep_pass))
        with bar:
            keep(residual.parameters)
            solve(residual, residual.parameters, steps, bar.update, keep)
        residual.set(found[chosen(errors_n) if errors_n else -1])
    return history


def chosen(errors: list[np.ndarray]) -> int:
    """Of the errors (frames,) on the validation split after each step, the one that is kept: the last, but
    where the smallest mean is below it by more than the standard error of their difference, that one."""
    means = [error.mean() for error in errors]
    best, last = int(np.argmin(means)), len(errors) - 1
    difference = errors[last] - errors[best]
    standard_error = difference.std() / np.sqrt(len(difference))
    return best if difference.mean() > standard_error else last
