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

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Self

import numpy as np
import torch
from scipy.optimize import OptimizeResult, least_squares
from torch.func import jacrev, vmap

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.force import ridge
from fastac.models.training.whole_frames.frames import WholeFrames, some_at_a_time
from fastac.models.training.whole_frames.held_out_force import REGULARISATION
from fastac.models.training.whole_frames.pixel_grid import WHOLE, Grid, every_row

FRAMES_AT_A_TIME = 8
"""Of which a thread finds features or derivatives: more of them take more memory and no less time."""
PARTS = 4
"""Of a frame's rows, of which the derivatives are found in turn: they take a quarter of the time. Errors are
of all pixels."""


def normals_of_columns(
    x: torch.Tensor, parameters: torch.Tensor, shapes: Sequence[tuple[int, int]]
) -> torch.Tensor:
    """Normals (..., 3, pixels) as a pixel network finds them, of scaled features (..., inputs, pixels):
    products are so much faster with a pixel in each column than, as elsewhere, in each row.

    parameters : of all layers in turn, the weights and then the biases (parameters,)
    shapes : of each layer's weights, (neurons, inputs)
    """
    layers = parameters.split([outputs * (inputs + 1) for outputs, inputs in shapes])
    for layer, (values, (outputs, inputs)) in enumerate(zip(layers, shapes, strict=True)):
        x = torch.relu(x) if layer else x
        weights, biases = values.split([outputs * inputs, outputs])
        x = weights.unflatten(0, (outputs, inputs)) @ x + biases[:, None]
    return x


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
        return self._flat.double().numpy()

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
        """Derivatives of `error_n`, (frames · axes, parameters): at the first call those of all pixels; at
        each further one, of the `PARTS` of the pixels the next is found anew for these parameters."""
        features, weights = self._fitted(parameters)
        parts = [self._part] if self._latest else range(PARTS)
        for part in parts:
            self._latest[part] = self._derivatives(weights, every_row(PARTS, part))
        self._part = (self._part + 1) % PARTS
        found = np.mean(list(self._latest.values()), axis=0, dtype=np.float64).reshape(len(features), -1)
        found -= features @ ridge.solve(features, found, REGULARISATION)[0]  # which weights make up for
        return found.reshape(-1, len(parameters))

    @property
    def _flat(self) -> torch.Tensor:
        return torch.nn.utils.parameters_to_vector(self.network.parameters()).detach()

    @property
    def _shapes(self) -> list[tuple[int, int]]:
        """Of the layers' weights, (neurons, inputs)."""
        return [tuple(layer.weight.shape) for layer in self.network.linear_layers]

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
        parameters, shapes = self._flat, self._shapes

        def model(x: torch.Tensor) -> torch.Tensor:
            return normals_of_columns(x.T, parameters, shapes).T

        find = partial(self.frames.features, model, grid=WHOLE)
        found = np.concatenate([part.double().numpy() for part in self._side_by_side(find, index)])
        return ridge.joined(found, self.frames.dot_shifts_px(index))

    def _derivatives(self, weights: np.ndarray, grid: Grid) -> np.ndarray:
        """Of the force by fixed weights (features, axes) at the pixels of a grid, (frames, axes, parameters);
        dots' shifts do not depend on the network."""
        of_slopes = self.frames.of_slopes
        of_sums, _ = ridge.parted(weights, of_slopes.count)
        of_pixels = of_slopes.pixel_weights(torch.from_numpy(of_sums).float(), grid)
        shape, of_pixels = of_pixels.shape[:2], of_pixels.flatten(0, 2)
        parameters, shapes = self._flat, self._shapes

        def force(parameters: torch.Tensor, x: torch.Tensor, columns: torch.Tensor | None) -> torch.Tensor:
            normals = normals_of_columns(x, parameters, shapes).T.unflatten(0, shape)
            return self.frames.slopes(normals, columns).flatten() @ of_pixels

        def find(index: np.ndarray) -> torch.Tensor:
            x, columns = self.frames.seen(index, grid)
            x = x.flatten(1, 2).transpose(1, 2).contiguous()
            along = (None, 0, None if columns is None else 0)
            found = vmap(jacrev(force), in_dims=along)(parameters, x, columns)
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

    def error_n(parameters: np.ndarray) -> np.ndarray:
        tried()
        return residual.error_n(parameters)

    def after(intermediate_result: OptimizeResult) -> None:
        nonlocal latest
        if not np.array_equal(intermediate_result.x, latest):
            lowered(intermediate_result.x)
        latest = intermediate_result.x.copy()

    return least_squares(
        error_n, start, residual.jacobian, x_scale="jac", gtol=None, max_nfev=steps, callback=after
    ).x
