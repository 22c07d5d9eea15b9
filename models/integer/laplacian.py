"""The discrete Poisson problem on the image: divergence of the slopes, Laplacian, its sine modes."""

from dataclasses import dataclass

import numpy as np


def sine_matrix(size: int) -> np.ndarray:
    """The orthonormal DST-I, sqrt(2/(N+1)) sin(π(k+1)(n+1)/(N+1)): symmetric and its own inverse, (N, N)."""
    index = np.arange(1, size + 1)
    return np.sqrt(2 / (size + 1)) * np.sin(np.pi * np.outer(index, index) / (size + 1))


def row_eigenvalues(size: int) -> np.ndarray:
    """Those of the second difference along N inner points, (N,), in (−4, 0)."""
    return 2 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1)) - 2


def eigenvalues(size: int) -> np.ndarray:
    """Those of the 5-point Laplacian on N×N inner points, (N, N), in (−8, 0)."""
    one = row_eigenvalues(size)
    return one[:, None] + one[None, :]


def boundary_term(rest: np.ndarray) -> np.ndarray:
    """Σ of the prior over each inner pixel's neighbours on the boundary; `rest` (H, W) to (H − 2, W − 2)."""
    term = np.zeros((rest.shape[0] - 2, rest.shape[1] - 2))
    term[0] += rest[0, 1:-1]
    term[-1] += rest[-1, 1:-1]
    term[:, 0] += rest[1:-1, 0]
    term[:, -1] += rest[1:-1, -1]
    return term


@dataclass(frozen=True)
class Stencil:
    """How the divergence takes a derivative of slopes: the slope `ahead` of a pixel less the one behind it.

    ahead : pixels from the pixel to the slope that counts with weight 1; that with weight −1 is at −1
    """

    ahead: int

    @property
    def span(self) -> int:
        """Pixels between both slopes; a derivative is their difference divided by it."""
        return self.ahead + 1

    @property
    def scale(self) -> float:
        """Slopes per pixel of one unit of difference."""
        return 1 / self.span

    @property
    def fraction_bits(self) -> int:
        """Fractional bits that a difference of slopes, taken as a derivative, has more than they."""
        return self.span.bit_length() - 1

    @property
    def norm(self) -> float:
        """Σ|weight| of a derivative."""
        return 2 * self.scale

    @property
    def kernel(self) -> np.ndarray:
        """The weights of a derivative, as np.convolve takes them to spread a value over the slopes."""
        return self.scale * np.array([1.0, *[0.0] * self.ahead, -1.0])

    def differences(self, values: np.ndarray, axis: int) -> np.ndarray:
        """Of values that are `span` apart along an axis, which becomes that much shorter."""
        places = [slice(None)] * values.ndim
        places[axis] = slice(self.span, None)
        later = values[tuple(places)]
        places[axis] = slice(None, -self.span)
        return later - values[tuple(places)]


CENTRAL = Stencil(ahead=1)
BACKWARD = Stencil(ahead=0)
STENCILS = {"central": CENTRAL, "backward": BACKWARD}
"""The divergences by their names in the scene; `backward` is the paper's."""


def divergence_of(slopes: np.ndarray, divergence: str) -> np.ndarray:
    """Slopes (..., H, W, 2) to their divergence (..., H − 2, W − 2); see PoissonSource for its units.

    Arrays of NumPy or tensors of torch.
    """
    stencil = STENCILS[divergence]
    inner, rest = slice(1, -1), stencil.ahead - 1 or None
    p, q = slopes[..., inner, :rest, 0], slopes[..., :rest, inner, 1]
    return stencil.differences(p, p.ndim - 1) + stencil.differences(q, q.ndim - 2)


def transposed_differences(weights: np.ndarray, divergence: str) -> np.ndarray:
    """The transpose of `divergence_of`: weights (..., N, N) of its values to weights of the slopes
    (..., N + 2, N + 2, 2)."""
    n = weights.shape[-1]
    ahead = STENCILS[divergence].ahead
    slopes = np.zeros((*weights.shape[:-2], n + 2, n + 2, 2))
    inner, plus, minus = slice(1, n + 1), slice(1 + ahead, n + 1 + ahead), slice(0, n)
    slopes[..., inner, plus, 0] += weights
    slopes[..., inner, minus, 0] -= weights
    slopes[..., plus, inner, 1] += weights
    slopes[..., minus, inner, 1] -= weights
    return slopes
