"""The force by weights that have not seen the frame, as a loss of the pixel network.

A network that is trained on the error of weights fitted to the same frames learns these frames by heart. So
presses are divided into parts, and the weights that find the force of one part are fitted to the others,
again before each epoch. The force is linear in features of what the network finds (force_features.py).
Source of the division: Chernozhukov et al., "Double/debiased machine learning for treatment and structural
parameters", The Econometrics Journal 21, 2018 (cross-fitting).
"""

from typing import Self

import numpy as np
import torch

from fastac.models.training.force import ridge
from fastac.sensor.dataset import Dataset
from fastac.sensor.groups import groups

REGULARISATION = np.array([1e-4])
"""As in `ridge.solve`."""
PARTS = 4
"""Into which the presses that are learned from are divided."""


class HeldOutForce:
    """Weights of features, fitted without the part of presses that they are used for.

    force_n : (frames, axes) of all frames, float32; together : (frames,) integers, the same for frames of one
    press; learned : the frames that weights are fitted to. Those of all other frames see all of `learned`.
    `refit` must be called before `error`.
    """

    def __init__(self, force_n: np.ndarray, together: np.ndarray, learned: np.ndarray):
        self.learned, self.force_n = learned, torch.from_numpy(force_n.astype(np.float32))
        names, press = np.unique(together[learned], return_inverse=True)
        self.part = np.full(len(force_n), PARTS)
        self.part[learned] = (np.random.default_rng(0).permutation(len(names)) % PARTS)[press]
        self.weights = torch.empty(0)

    @classmethod
    def of(cls, data: Dataset, axes: tuple[int, ...], learned: np.ndarray) -> Self:
        """Of a dataset's frames and their forces along `axes`."""
        return cls(data.forces_n(np.arange(len(data)), axes), groups(data), learned)

    def refit(self, features: torch.Tensor) -> None:
        """Fit the weights anew to the `features` of the frames `learned`, in their order."""
        x, part = features.double().numpy(), self.part[self.learned]
        force_n = self.force_n[torch.from_numpy(self.learned)].double().numpy()
        found = []
        for k in range(PARTS + 1):
            seen = part != k
            if not seen.any():  # a single press
                seen[:] = True
            found.append(ridge.solve(x[seen], force_n[seen], REGULARISATION)[0])
        self.weights = torch.from_numpy(np.stack(found).astype(np.float32))

    def error(self, features: torch.Tensor, index: np.ndarray) -> torch.Tensor:
        """The mean over frames `index` of the absolute errors in N, summed over the axes."""
        weights = self.weights[torch.from_numpy(self.part[index])]
        found = torch.einsum("nf,nfa->na", features, weights)
        return (found - self.force_n[torch.from_numpy(index)]).abs().sum(dim=1).mean()
