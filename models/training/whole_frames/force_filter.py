"""Least squares on the force, a few presses at a time: an extended Kalman filter of network and weights.

Each batch of presses moves the pixel network's parameters and the force's weights together, by a Gauss-Newton
step that what earlier presses told holds back. Those are forgotten by and by, since their derivatives are
those of a network that has changed. A pass over all presses has dozens of such steps and takes as long as one
on all presses at once; and by the chance that is in each batch it gets past poor minima that steps on all
presses end in. Sources: Singhal, Wu, "Training multilayer perceptrons with the extended Kalman algorithm",
NIPS 1988; Puskorius, Feldkamp, "Neurocontrol of nonlinear dynamical systems with Kalman filter trained
recurrent networks", IEEE Trans. Neural Networks 5, 1994; of forgetting, Ljung, Söderström, "Theory and
Practice of Recursive Identification", MIT Press 1983, section 2.6.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import block_diag, solve

from fastac.models.training.force.ridge import root_mean_squares
from fastac.models.training.whole_frames.force_residual import PARTS, ForceResidual
from fastac.models.training.whole_frames.pixel_grid import every_row

UPDATES = 48
"""Of a pass over all presses."""
SHORTEST, LONGEST = 0.25, 4.0
"""Time after which a press is all but forgotten, in passes: at first, so that parameters go far, and at last,
so that they settle."""
CHANGE = 0.2
"""Expected of a parameter in that time, as a standard deviation; parameters are a few tenths each."""
LARGEST_STEP = 0.5
"""Of an update, of all parameters of the network together."""


class ForceFilter:
    """The pixel network's parameters, the force's weights, and what presses so far tell about them.

    residual : of the presses to learn from, which the weights are fitted to at first, and whose network is
        what the parameters start from
    parameters : of the network, (parameters,); weights : of the force, (features, axes)
    """

    def __init__(self, residual: ForceResidual):
        self.residual, self.parameters = residual, residual.parameters
        features, self.weights = residual.fitted(self.parameters)
        self._spread = root_mean_squares(features)
        of_weights = (features / self._spread).T @ (features / self._spread)
        unknown = np.zeros((len(self.parameters),) * 2)
        self._information = block_diag(unknown, *[of_weights] * self.weights.shape[1])
        self._updates = 0

    def update(self, index: np.ndarray, kept: float) -> np.ndarray:
        """Learn from the presses `index`, of what earlier ones told a share `kept`; returns the errors of
        these presses before it, (presses, axes) in N."""
        some = self.residual.of(index)
        some.set(self.parameters)
        features = some.features(index)
        errors_n = features @ self.weights - some.force_n(index)
        if not errors_n.any():  # all at rest: nothing to learn, and no error to judge a step by
            return errors_n
        axes, rows = errors_n.shape[1], every_row(PARTS, self._updates % PARTS)
        by_weights = np.einsum("nf,ab->nabf", features / self._spread, np.eye(axes)).reshape(
            *errors_n.shape, -1
        )
        by_all = np.concatenate([some.derivatives(self.weights, rows), by_weights], axis=2)
        by_all = by_all.reshape(errors_n.size, -1)
        self._information = kept * self._information + by_all.T @ by_all
        known = self._information + (errors_n**2).mean() / CHANGE**2 * np.eye(by_all.shape[1])
        step = solve(known, by_all.T @ errors_n.ravel(), assume_a="pos")
        of_network, of_weights = np.split(step, [len(self.parameters)])
        shorter = min(1.0, LARGEST_STEP / max(np.linalg.norm(of_network), LARGEST_STEP))
        self.parameters = self.parameters - shorter * of_network
        self.weights = self.weights - shorter * of_weights.reshape(axes, -1).T / self._spread[:, None]
        self._updates += 1
        return errors_n

    def errors_n(self, index: np.ndarray) -> np.ndarray:
        """Found less true forces of the presses `index`, (presses, axes) in N."""
        self.residual.set(self.parameters)
        return self.residual.features(index) @ self.weights - self.residual.force_n(index)


def learn(
    residual: ForceResidual,
    passes: int,
    updated: Callable[[], object],
    passed: Callable[[ForceFilter, float], object],
) -> np.ndarray:
    """The parameters (parameters,) of the network after so many passes over the presses of `residual`.

    updated : is called after each update, of which a pass has `UPDATES`; passed : after each pass, with the
        filter and the mean error of presses in N, summed over the axes, each before it was learned from
    """
    rng = np.random.default_rng((residual.frames.scene.training.seed, 3))  # other draws than other stages'
    found, index = ForceFilter(residual), residual.index
    # From the shortest memory, for the first half of the passes, to the longest by equal factors.
    shares = np.clip(np.linspace(-1, 1, passes), 0, None)
    for memory in SHORTEST * (LONGEST / SHORTEST) ** shares:
        batches = np.array_split(rng.permutation(index), min(UPDATES, len(index)))
        errors_n, kept = [], max(0.0, 1 - 1 / (memory * len(batches)))
        for batch in batches:
            errors_n.append(np.abs(found.update(np.sort(batch), kept)).sum(axis=1))
            updated()
        passed(found, float(np.concatenate(errors_n).mean()))
    return found.parameters
