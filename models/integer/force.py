"""The force in integers: position-dependent K×K kernels, or one weight for each value."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fastac.models.integer.words import _fits, exact_matmul, signed_width


def terms(displacement: np.ndarray, bends: tuple[float, ...]) -> np.ndarray:
    """What has weights of its own in a displacement (...), in (..., terms).

    bends : (), (band,) or (band, deep, deeper, …), ascending, in the displacement's unit

    The displacement itself; with a band also what of it is beyond the band towards the camera, and what is
    beyond it away from the camera; for each further bend also what is beyond that towards the camera. So
    untouched skin, the bulge around a contact, its edge and its middle can each have a weight.
    """
    if not bends:
        return displacement[..., None]
    band, *deep = bends
    beyond = np.maximum(displacement - band, 0), np.minimum(displacement + band, 0)
    return np.stack([displacement, *beyond, *(np.maximum(displacement - d, 0) for d in deep)], axis=-1)


def block_means(images: np.ndarray, block_px: int) -> np.ndarray:
    """Images (count, rows, columns, …) of floats in which all pixels of a square have its mean.

    block_px : side of the squares
    Squares begin at the first row and column; those at the other borders may be cut.
    """
    if block_px == 1:
        return images
    found = images
    for axis in (1, 2):
        first = np.arange(0, images.shape[axis], block_px)
        count = np.diff(first, append=images.shape[axis])
        sums = np.moveaxis(np.add.reduceat(found, first, axis=axis), axis, -1)
        found = np.moveaxis(np.repeat(sums / count.astype(images.dtype), count, axis=-1), -1, axis)
    return found


@dataclass(frozen=True, eq=False)
class PatchForce:
    """Position-dependent K×K kernels on the displacement, summed over the frame: A = Σ_p Σ_m k_{p,m} v_{p,m}.

    Outside the inner region the displacement is zero.
    """

    kernel: np.ndarray  # (axes, N, N, K, K)
    kernel_bits: int
    displacement_bits: int
    signed: bool = False
    """Whether displacements are, as without the clamp."""

    def __post_init__(self):
        _fits("kernel", self.kernel, self.kernel_bits, signed=True)

    @property
    def displacement_limit(self) -> int:
        """The largest magnitude of a displacement."""
        return (1 << (self.displacement_bits - 1 if self.signed else self.displacement_bits)) - 1

    @property
    def size(self) -> int:
        """K, the side of the window."""
        return self.kernel.shape[-1]

    @cached_property
    def pixel_bound(self) -> int:
        return int(np.abs(self.kernel).sum(axis=(-2, -1)).max()) * self.displacement_limit

    @cached_property
    def bound(self) -> int:
        """Σ|k|·displacement_limit over the whole frame, the worst axis."""
        return int(np.abs(self.kernel).sum(axis=(1, 2, 3, 4)).max()) * self.displacement_limit

    @property
    def pixel_width(self) -> int:
        return signed_width(self.pixel_bound)

    @property
    def width(self) -> int:
        return signed_width(self.bound)

    def force_map(self, q: np.ndarray) -> np.ndarray:
        """Displacement words (..., N, N) to pixel-wise responses (..., axes, N, N)."""
        half = self.size // 2
        padding = [(0, 0)] * (q.ndim - 2) + [(half, half), (half, half)]
        windows = np.lib.stride_tricks.sliding_window_view(
            np.pad(q, padding), (self.size, self.size), axis=(-2, -1)
        )
        return np.einsum("...ijkl,aijkl->...aij", windows, self.kernel)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Displacement words (..., N, N) to raw accumulators (..., axes)."""
        return self.force_map(q).sum(axis=(-2, -1))

    def collapsed(self) -> "WeightedSum":
        """The same resultant from one weight a pixel: Σ_p Σ_m k_{p,m} v_{p+m} = Σ_p (Σ_m k_{p−m,m}) v_p."""
        axes, n, _, k, _ = self.kernel.shape
        half = k // 2
        weight = np.zeros((axes, n + 2 * half, n + 2 * half), np.int64)
        for i in range(k):
            for j in range(k):
                weight[:, i : i + n, j : j + n] += self.kernel[..., i, j]
        inner = slice(half, half + n)
        return WeightedSum(
            weight[:, inner, inner, None], np.zeros(axes, np.int64), self.displacement_bits, self.signed
        )


@dataclass(frozen=True, eq=False)
class WeightedSum:
    """One sum over the whole frame for each axis: A = constant + Σ_p Σ_t weight_{p,t} · x_{p,t}.

    With the displacement (one term a pixel) it is the collapsed kernels' force, with the slopes p and q (two
    terms) the adjoint's. With bends the displacement has more, see `terms`.
    """

    weight: np.ndarray  # (axes, rows, columns, terms)
    constant: np.ndarray  # (axes,)
    input_width: int
    input_signed: bool
    loadable: bool = False
    """Whether the hardware may be loaded with other constants, any sum of other inputs."""
    block_px: int = 1
    """Side of the squares whose pixels have the same weights, a power of two: hardware keeps one word for
    each. Squares at the right border may be cut, too."""
    cut_rows: int = 0
    """Rows that the uppermost squares lack, where rows come last row first; others are cut below."""

    def __post_init__(self):
        if self.weight.ndim != 4 or self.constant.shape != self.weight.shape[:1]:
            raise ValueError(
                f"weight {self.weight.shape}, constant {self.constant.shape}:"
                " expected (axes, rows, columns, terms) and (axes,)"
            )
        if self.block_px < 1 or self.block_px & (self.block_px - 1) or not 0 <= self.cut_rows < self.block_px:
            raise ValueError(
                f"block_px = {self.block_px}, cut_rows = {self.cut_rows}: expected a power of two, and fewer"
                " rows than that"
            )
        rows, columns = self._blocks
        if self.block_px > 1 and (self.block_weight[:, rows][:, :, columns] != self.weight).any():
            raise ValueError(f"weight: not the same in all squares of block_px = {self.block_px}")

    @property
    def _blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """The square of each row and of each column."""
        rows, columns = self.weight.shape[1:3]
        return (np.arange(rows) + self.cut_rows) // self.block_px, np.arange(columns) // self.block_px

    @property
    def block_weight(self) -> np.ndarray:
        """The weights of each square, (axes, rows of squares, columns of squares, terms)."""
        first = [np.unique(of_line, return_index=True)[1] for of_line in self._blocks]
        return self.weight[:, first[0]][:, :, first[1]]

    def reversed_rows(self) -> "WeightedSum":
        """The sum of a frame whose rows come last row first."""
        below = -(self.weight.shape[1] + self.cut_rows) % self.block_px
        return replace(self, weight=self.weight[:, ::-1], cut_rows=below)

    @property
    def input_limit(self) -> int:
        """The largest magnitude of an input, which is never the lowest word of a signed format."""
        return (1 << (self.input_width - 1 if self.input_signed else self.input_width)) - 1

    @cached_property
    def weight_width(self) -> int:
        return signed_width(int(np.abs(self.weight).max()))

    @cached_property
    def bound(self) -> int:
        """|constant| + Σ|weight|·input_limit, the worst axis."""
        reached = np.abs(self.weight).sum(axis=(1, 2, 3)) * self.input_limit
        return int(((reached if self.loadable else np.abs(self.constant)) + reached).max())

    @property
    def width(self) -> int:
        return signed_width(self.bound)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Inputs (..., rows, columns, terms) to raw accumulators (..., axes)."""
        flat = self.weight.reshape(len(self.weight), -1)
        sums = exact_matmul(x.reshape(*x.shape[:-3], -1), flat.T, self.bound)
        return sums + self.constant
