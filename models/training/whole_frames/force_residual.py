"""The force's error on whole frames and its exact derivatives, for least squares on the pixel network.

For given weights of the network, those of the force that leave the smallest error follow from a linear fit.
So the network's are searched alone; of their derivatives, what the force's weights would make up for is taken
away. Sources: Golub, Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems
whose variables separate", SIAM J. Numer. Anal. 10, 1973; of the derivatives that are used, Kaufman, "A
variable projection method for solving separable nonlinear least squares problems", BIT 15, 1975.
"""

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import torch
from torch.func import functional_call, jacrev, vmap

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.force import ridge
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.models.training.whole_frames.held_out_force import REGULARISATION
from fastac.models.training.whole_frames.pixel_grid import WHOLE, Grid, every_row

FRAMES_AT_A_TIME = 8
"""Of which a thread finds features or derivatives: more of them take more memory and no less time."""
PARTS = 4
"""Of a frame's rows, of which the derivatives are found in turn. They are alike, and take a quarter of the
time; errors are of all pixels."""


class ForceResidual:
    """Errors of the force on some frames, as a function of the pixel network's parameters.

    frames : of a scene whose force is a sum of slopes, with the force along its axes
    network : whose parameters are set to those that are asked for
    index : the frames that the force's weights are fitted to, and whose errors these are
    """

    def __init__(self, frames: WholeFrames, network: PixelNetwork, index: np.ndarray):
        self.frames, self.network, self.index = frames, network, index
        self.threads = torch.get_num_threads()
        self._known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._part = 0

    @property
    def parameters(self) -> np.ndarray:
        """The network's, (parameters,) float64."""
        return torch.cat([values.detach().flatten() for values in self.network.parameters()]).double().numpy()

    def set(self, parameters: np.ndarray) -> None:
        """Give the network these parameters (parameters,)."""
        torch.nn.utils.vector_to_parameters(torch.from_numpy(parameters).float(), self.network.parameters())

    def error_n(self, parameters: np.ndarray) -> np.ndarray:
        """Found less true forces in N, (frames · axes,)."""
        features, weights = self._fitted(parameters)
        return (features @ weights - self._force_n(self.index)).ravel()

    def error_elsewhere_n(self, parameters: np.ndarray, index: np.ndarray) -> np.ndarray:
        """The same on other frames, (frames, axes), by the force's weights of those that are learned from."""
        _, weights = self._fitted(parameters)
        return self._features(index) @ weights - self._force_n(index)

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        """Derivatives of `error_n`, (frames · axes, parameters), from one of the `PARTS` of the pixels, at
        each call the next."""
        features, weights = self._fitted(parameters)
        grid, self._part = every_row(PARTS, self._part), (self._part + 1) % PARTS
        found = self._derivatives(weights, grid).astype(np.float64).reshape(len(features), -1)
        found -= features @ ridge.solve(features, found, REGULARISATION)[0]  # which weights make up for
        return found.reshape(-1, len(parameters))

    def _force_n(self, index: np.ndarray) -> np.ndarray:
        return self.frames.data.forces_n(index, self.frames.scene.force_axes)

    def _fitted(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Features (frames, features) by these parameters, which the network then has, and the force's
        weights (features, axes)."""
        self.set(parameters)
        if self._known is None or not np.array_equal(self._known[0], parameters):
            features = self._features(self.index)
            weights = ridge.solve(features, self._force_n(self.index), REGULARISATION)[0]
            self._known = parameters.copy(), features, weights
        return self._known[1:]

    def _features(self, index: np.ndarray) -> np.ndarray:
        """What the force is linear in, of all pixels, (frames, features) float64: sums of slopes and then,
        where they are a part of it, the shifts of the dots."""
        find = partial(self.frames.features, self.network, grid=WHOLE)
        found = np.concatenate([part.double().numpy() for part in self._side_by_side(find, index)])
        return ridge.joined(found, self.frames.dot_shifts_px(index))

    def _derivatives(self, weights: np.ndarray, grid: Grid) -> np.ndarray:
        """Of the force by fixed weights (features, axes) at the pixels of a grid, (frames, axes, parameters);
        dots' shifts do not depend on the network."""
        of_slopes = self.frames.of_slopes
        of_sums, _ = ridge.parted(weights, of_slopes.count)
        of_pixels = of_slopes.pixel_weights(torch.from_numpy(of_sums).float(), grid).flatten(0, 2)
        parameters = {name: values.detach() for name, values in self.network.named_parameters()}

        def find(index: np.ndarray) -> torch.Tensor:
            network = copy.deepcopy(self.network)  # a thread's own: it is given traced parameters

            def force(parameters: dict, x: torch.Tensor, columns: torch.Tensor | None) -> torch.Tensor:
                normals = functional_call(network, parameters, (x,))
                return self.frames.slopes(normals, columns).flatten() @ of_pixels

            x, columns = self.frames.seen(index, grid)
            along = (None, 0, None if columns is None else 0)
            found = vmap(jacrev(force), in_dims=along)(parameters, x, columns)
            found = torch.cat([found[name].flatten(2) for name in parameters], dim=2)
            return found[:-1] - found[-1:]  # less that at rest

        return np.concatenate([part.numpy() for part in self._side_by_side(find, self.index)])

    def _side_by_side(
        self, find: Callable[[np.ndarray], torch.Tensor], index: np.ndarray
    ) -> list[torch.Tensor]:
        """What `find` returns of the frames, some at a time, on as many threads as torch may use."""
        parts = np.split(index, range(FRAMES_AT_A_TIME, len(index), FRAMES_AT_A_TIME))
        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(find, parts))
