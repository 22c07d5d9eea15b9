"""The force's error on whole frames and its exact derivatives, for least squares on the pixel network.

For given weights of the network, those of the force that leave the smallest error follow from a linear fit.
So the network's are searched alone; of their derivatives, what the force's weights would make up for is taken
away. Derivatives are found of a part of the pixels at a time, and those of the other parts are kept from the
steps before: near the end, where steps are small, they are almost the same. Sources: Golub, Pereyra, "The
differentiation of pseudo-inverses and nonlinear least squares problems whose variables separate", SIAM J.
Numer. Anal. 10, 1973; of the derivatives that are used, Kaufman, "A variable projection method for solving
separable nonlinear least squares problems", BIT 15, 1975; of parts that are renewed in turn, Le Roux,
Schmidt, Bach, "A stochastic gradient method with an exponential convergence rate for finite training sets",
NIPS 2012. Steps: scipy.optimize.least_squares, after Branch, Coleman, Li, "A subspace, interior, and
conjugate gradient method for large-scale bound-constrained minimization problems", SIAM J. Sci. Comput. 21,
1999.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Self

import numpy as np
import torch
from scipy.optimize import OptimizeResult, least_squares

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.force import ridge
from fastac.models.training.whole_frames.frames import WholeFrames, some_at_a_time
from fastac.models.training.whole_frames.held_out_force import REGULARISATION
from fastac.models.training.whole_frames.network_of_columns import NetworkOfColumns
from fastac.models.training.whole_frames.pixel_grid import WHOLE, Grid, every_row

FRAMES_AT_A_TIME = 8
"""Of which a thread finds features or derivatives: more of them take more memory and no less time."""
PARTS = 4
"""Of a frame's rows, of which the derivatives are found in turn: they take a quarter of the time. Errors are
of all pixels."""
FIRST_LENGTH = 0.3
"""Of the first step of least squares that is tried, by all parameters, which are a few tenths each."""


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
        self._part, self._latest = 0, {}  # of which derivatives are found next; those found, by part

    def of(self, index: np.ndarray) -> Self:
        """That of other frames, on as many threads."""
        found = type(self)(self.frames, self.network, index)
        found.threads = self.threads
        return found

    @property
    def parameters(self) -> np.ndarray:
        """The network's, (parameters,) float64."""
        return torch.nn.utils.parameters_to_vector(self.network.parameters()).detach().double().numpy()

    def set(self, parameters: np.ndarray) -> None:
        """Give the network these parameters (parameters,)."""
        torch.nn.utils.vector_to_parameters(torch.from_numpy(parameters).float(), self.network.parameters())

    def error_n(self, parameters: np.ndarray) -> np.ndarray:
        """Found less true forces in N, (frames · axes,)."""
        features, weights = self.fitted(parameters)
        return (features @ weights - self.force_n(self.index)).ravel()

    def error_elsewhere_n(self, parameters: np.ndarray, index: np.ndarray) -> np.ndarray:
        """The same on other frames, (frames, axes), by the force's weights of those that are learned from."""
        _, weights = self.fitted(parameters)
        return self.features(index) @ weights - self.force_n(index)

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        """Derivatives of `error_n`, (frames · axes, parameters): at the first call those of all pixels; at
        each further one, of the `PARTS` of the pixels the next is found anew for these parameters."""
        features, weights = self.fitted(parameters)
        parts = [self._part] if self._latest else range(PARTS)
        for part in parts:
            self._latest[part] = self.derivatives(weights, every_row(PARTS, part))
        self._part = (self._part + 1) % PARTS
        found = np.mean(list(self._latest.values()), axis=0, dtype=np.float64).reshape(len(features), -1)
        found -= features @ ridge.solve(features, found, REGULARISATION)[0]  # which weights make up for
        return found.reshape(-1, len(parameters))

    def force_n(self, index: np.ndarray) -> np.ndarray:
        """True forces of some frames in N, (frames, axes)."""
        return self.frames.data.forces_n(index, self.frames.scene.force_axes)

    def fitted(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Features (frames, features) by these parameters, which the network then has, and the force's
        weights (features, axes)."""
        self.set(parameters)
        if self._known is None or not np.array_equal(self._known[0], parameters):
            features = self.features(self.index)
            weights = ridge.solve(features, self.force_n(self.index), REGULARISATION)[0]
            self._known = parameters.copy(), features, weights
        return self._known[1:]

    def features(self, index: np.ndarray) -> np.ndarray:
        """What the force is linear in, of all pixels, (frames, features) float64: sums of slopes and then,
        where they are a part of it, the shifts of the dots."""
        network = NetworkOfColumns(self.network)

        def model(x: torch.Tensor) -> torch.Tensor:
            return network(x.T).T

        find = partial(self.frames.features, model, grid=WHOLE)
        found = np.concatenate([part.double().numpy() for part in self._side_by_side(find, index)])
        return ridge.joined(found, self.frames.dot_shifts_px(index))

    def derivatives(self, weights: np.ndarray, grid: Grid) -> np.ndarray:
        """Of the force by fixed weights (features, axes) at the pixels of a grid, (frames, axes, parameters);
        dots' shifts do not depend on the network."""
        of_slopes = self.frames.of_slopes
        of_sums, _ = ridge.parted(weights, of_slopes.count)
        of_pixels = of_slopes.pixel_weights(torch.from_numpy(of_sums).float(), grid)
        shape, of_pixels = of_pixels.shape[:2], of_pixels.flatten(0, 2)
        network = NetworkOfColumns(self.network)

        def find(index: np.ndarray) -> torch.Tensor:
            x, columns = self.frames.seen(index, grid)
            stages = [network.stages(frame) for frame in x.flatten(1, 2).transpose(1, 2).contiguous()]
            normals = torch.stack([found[-1].T for found in stages]).unflatten(1, shape).requires_grad_()
            forces = self.frames.slopes(normals, columns).flatten(1) @ of_pixels
            by_normals = [  # of each axis, of all frames at once: each depends on its own normals alone
                torch.autograd.grad(of_axis.sum(), normals, retain_graph=True)[0].flatten(1, 2).mT
                for of_axis in forces.unbind(1)
            ]
            of_frames = zip(stages, torch.stack(by_normals, dim=1), strict=True)
            found = torch.stack([network.derivatives(*frame) for frame in of_frames])
            return found[:-1] - found[-1:]  # less that at rest

        return np.concatenate([part.numpy() for part in self._side_by_side(find, self.index)])

    def _side_by_side(
        self, find: Callable[[np.ndarray], torch.Tensor], index: np.ndarray
    ) -> list[torch.Tensor]:
        """What `find` returns of the frames, some at a time, on as many threads as torch may use."""
        # New threads may share a product among more of torch's own: its sums then differ in the last bit.
        with ThreadPoolExecutor(self.threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
            return list(pool.map(find, some_at_a_time(index, FRAMES_AT_A_TIME)))


def solve(
    residual: ForceResidual,
    start: np.ndarray,
    steps: int,
    tried: Callable[[], object],
    lowered: Callable[[np.ndarray], object] = lambda parameters: None,
) -> np.ndarray:
    """The parameters (parameters,) that so many steps of least squares from `start` find.

    tried : is called at each step; lowered : is given the parameters after each that lowered the error
    """
    latest = start

    # Scaled by their derivatives, parameters of neurons that hardly any pixel activates would go anywhere.
    # From a start at zero scipy tries a step as long as the scale, from elsewhere one as long as the start.
    def error_n(step: np.ndarray) -> np.ndarray:
        tried()
        return residual.error_n(start + step)

    def jacobian(step: np.ndarray) -> np.ndarray:
        return residual.jacobian(start + step)

    def after(intermediate_result: OptimizeResult) -> None:
        nonlocal latest
        parameters = start + intermediate_result.x
        if not np.array_equal(parameters, latest):
            lowered(parameters)
        latest = parameters

    none = np.zeros_like(start)
    found = least_squares(
        error_n, none, jacobian, x_scale=FIRST_LENGTH, gtol=None, max_nfev=steps, callback=after
    )
    return start + found.x
