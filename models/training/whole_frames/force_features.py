"""What the force is linear in while the pixel network learns from it: few numbers of a frame, differentiable.

They are sums over the image, weighted by its lowest cosines, so that weights of theirs are weights of the
pixels that are smooth over the image.
"""

import torch

from fastac.models.training.force.smooth_weights import cosine_basis
from fastac.models.training.whole_frames.pixel_grid import WHOLE, Grid

SLOPES_SIZE = 8
"""Number of cosines along each axis for the slopes."""
DISPLACEMENT_SIZE = 4
"""The same for the displacement. With more, the error of held-out presses is no smaller."""
LARGEST_KERNEL = 3
"""Side of the largest neighbourhood that counts apart: the force of a larger kernel is much the same."""


def _basis(length: int, size: int) -> torch.Tensor:
    return torch.from_numpy(cosine_basis(length, min(size, length))).float()


class OfSlopes:
    """The lowest cosines of both slopes' change, for a force that is a sum of slopes."""

    def __init__(self, shape: tuple[int, int]):
        """shape : (H, W) of the frames"""
        self.rows, self.columns = (_basis(length, SLOPES_SIZE) for length in shape)

    @property
    def count(self) -> int:
        """Of the features."""
        return self.rows.shape[1] * self.columns.shape[1] * 2

    def __call__(self, change: torch.Tensor, grid: Grid = WHOLE) -> torch.Tensor:
        """Slopes less those at rest (frames, h, w, 2) to features (frames, cosines · 2).

        grid : the pixels (h, w) that they are of; each counts for as many as there are to one of the grid
        """
        rows, columns = self._cosines(grid)
        return torch.einsum("nyxt,yi,xj->nijt", change, rows, columns).flatten(1)

    def pixel_weights(self, weights: torch.Tensor, grid: Grid = WHOLE) -> torch.Tensor:
        """Weights of the features (features, axes) as those of the pixels' slopes, (h, w, 2, axes)."""
        rows, columns = self._cosines(grid)
        weights = weights.unflatten(0, (rows.shape[1], columns.shape[1], 2))
        return torch.einsum("ijta,yi,xj->yxta", weights, rows, columns)

    def _cosines(self, grid: Grid) -> tuple[torch.Tensor, torch.Tensor]:
        """Along the rows and columns of a grid, (h, cosines) and (w, cosines)."""
        rows, columns = self.rows[grid[0]], self.columns[grid[1]]
        return rows * (len(self.rows) / len(rows)), columns * (len(self.columns) / len(columns))


class OfDisplacement:
    """The lowest cosines of the displacement and its neighbours', for a force of kernels on it."""

    def __init__(self, size: int, kernel_size: int, *, clamp: bool):
        """size : N of the displacement; kernel_size : K of the scene's kernels; clamp : whether negative
        displacement counts as none"""
        self.basis, self.clamp = _basis(size, DISPLACEMENT_SIZE), clamp
        self.side = min(kernel_size, LARGEST_KERNEL)

    def __call__(self, displacement: torch.Tensor) -> torch.Tensor:
        """Displacement (frames, N, N), in any unit, to features (frames, neighbours · cosines)."""
        size, reach = len(self.basis), self.side // 2
        known = torch.relu(displacement) if self.clamp else displacement
        known = torch.nn.functional.pad(known, (reach,) * 4)
        found = []
        for row in range(self.side):
            columns = torch.einsum("nyx,yi->nix", known[:, row : row + size], self.basis)
            for column in range(self.side):
                moved = columns[..., column : column + size]
                found.append(torch.einsum("nix,xj->nij", moved, self.basis).flatten(1))
        return torch.cat(found, dim=1)
