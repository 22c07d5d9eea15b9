"""Training of the pixel network for a force that is a sum of its slopes, by nonlinear least squares.

An elastic layer's force is not linear in the slopes, so the network bends them until it is. It has a few
hundred parameters: few enough to take the exact derivatives of every press's force and solve for all of them
together, which in a dozen steps leaves six tenths of the error that thousands of gradient steps leave.
Nothing is left of the normals, which may be any whose sum is the force. Steps: scipy.optimize.least_squares,
after Branch, Coleman, Li, "A subspace, interior, and conjugate gradient method for large-scale
bound-constrained minimization problems", SIAM J. Sci. Comput. 21, 1999.
"""

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from threadpoolctl import threadpool_limits

from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.threads import single_thread
from fastac.models.training.whole_frames.force_residual import ForceResidual
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.store.progress import progress_bar

LABEL = "force, least squares"


def train(network: PixelNetwork, frames: WholeFrames, *, progress: bool = False) -> list[dict]:
    """Train the float network on for the scene's `training.force_steps`; it is changed itself.

    It learns from the train split. Returns the learning curve: of each step that lowered the error the mean
    absolute error in N, summed over the axes, of the train and, if there is one, the validation split. The
    network keeps the last parameters but where the validation error tells that earlier ones were better
    (`chosen`).
    Raises ValueError where the frames are too few for the network.
    """
    index, validation = frames.index("train"), frames.index("validation")
    residual = ForceResidual(frames, network, index)
    start, steps = residual.parameters, frames.scene.training.force_steps
    axes = len(frames.scene.force_axes)
    searched, forces = len(start) + frames.of_slopes.count * axes, len(index) * axes
    if forces < searched:
        raise ValueError(
            f"split: the train split has {forces} forces for {searched} parameters of the network and weights"
            " of the force; training.force_steps needs more, 0 does without"
        )
    history: list[dict] = []
    found, errors_n = [], []
    bar = progress_bar(total=steps, desc=LABEL, unit="step", enabled=progress)

    def keep(parameters: np.ndarray) -> None:
        train_n = np.abs(residual.error_n(parameters)).sum() / len(index)
        entry = {"epoch": len(history), "train_mae_n": train_n}
        if len(validation):
            errors_n.append(np.abs(residual.error_elsewhere_n(parameters, validation)).sum(axis=1))
            entry["validation_mae_n"] = errors_n[-1].mean()
        history.append({key: float(value) for key, value in entry.items()})
        found.append(parameters.copy())
        bar.set_postfix({"mae": f"{entry['train_mae_n']:.4f} N"})

    def error_n(parameters: np.ndarray) -> np.ndarray:
        bar.update()
        return residual.error_n(parameters)

    def after(intermediate_result: OptimizeResult) -> None:
        if not np.array_equal(intermediate_result.x, found[-1]):  # else no step has lowered the error
            keep(intermediate_result.x)

    # Sums have the same order on every machine, and products this small are faster on one thread.
    with single_thread(), threadpool_limits(1), bar:
        keep(start)
        least_squares(
            error_n,
            start,
            residual.jacobian,
            x_scale="jac",
            gtol=None,
            max_nfev=steps,
            callback=after,
        )
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
