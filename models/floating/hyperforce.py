"""HyperForce: position-dependent convolution kernels from a coordinate-conditioned hypernetwork.

F = Σ_p w(c(p)) · v(p), with w(c(p)) the K×K kernel that the hypernetwork gives for the pixel's normalised
3-D coordinate and v(p) the displacement patch around it (zero outside the inner region).
Source: Lu et al., "FasTac", section "FEM-inspired Dynamic Convolution Network".
"""

import numpy as np
import torch
from torch import nn


def coordinates(rest_depth: np.ndarray) -> np.ndarray:
    """Normalised 3-D coordinates (N, N, 3) of the inner pixels of a skin at rest, (N, N), in −1 … 1."""
    n = len(rest_depth)
    line = np.linspace(-1, 1, n)
    low, high = rest_depth.min(), rest_depth.max()
    z = 2 * (rest_depth - low) / (high - low) - 1 if high > low else np.zeros_like(rest_depth)
    return np.stack([np.broadcast_to(line, (n, n)), np.broadcast_to(line[:, None], (n, n)), z], axis=-1)


class HyperForce(nn.Module):
    """Kernels for every inner pixel; `axes` force components from the normal displacement."""

    def __init__(self, coordinate: np.ndarray, *, kernel_size: int, hidden: int, axes: int = 1):
        super().__init__()
        self.kernel_size, self.axes, self.size = kernel_size, axes, len(coordinate)
        flat = torch.as_tensor(coordinate, dtype=torch.float32).reshape(-1, 3)
        self.register_buffer("coordinate", flat)
        # 1×1 convolutions over the coordinate image are these linear maps over its pixels.
        self.layers = nn.Sequential(
            nn.Linear(3, hidden),
            nn.Tanh(),
            nn.Linear(hidden, hidden),
            nn.Tanh(),
            nn.Linear(hidden, axes * kernel_size**2),
        )
        self.register_buffer("unit", torch.tensor(1.0))

    def kernels(self) -> torch.Tensor:
        """(axes, N, N, K, K) in N per mm."""
        k = self.kernel_size
        weights = self.layers(self.coordinate) * self.unit
        return weights.reshape(self.size, self.size, self.axes, k, k).permute(2, 0, 1, 3, 4)

    def set_force_unit(self, displacement: torch.Tensor, force_n: torch.Tensor) -> None:
        """Choose the unit so that weights of order one give forces of the order of `force_n`."""
        volume = displacement.abs().flatten(1).sum(dim=1).mean()
        unit = float(force_n.abs().mean() / volume.clamp(min=1e-9))
        self.unit.fill_(unit / self.kernel_size)

    def collapsed(self) -> torch.Tensor:
        """One weight per pixel, (axes, N, N); see `collapse`."""
        return _fold(self.kernels())

    def forward(self, displacement: torch.Tensor) -> torch.Tensor:
        """Displacements (frames, N, N) in mm to forces (frames, axes) in N."""
        return displacement.flatten(1) @ self.collapsed().flatten(1).T


def _fold(kernels: torch.Tensor) -> torch.Tensor:
    axes, n, _, k, _ = kernels.shape
    columns = kernels.reshape(axes, n * n, k * k).transpose(1, 2)
    return nn.functional.fold(columns, (n, n), k, padding=k // 2)[:, 0]


def collapse(kernels: np.ndarray) -> np.ndarray:
    """Kernels (axes, N, N, K, K) to one weight per pixel, (axes, N, N): its share of the resultant.

    Exact algebra: swapping the sums over pixels and over the window's offsets.
    """
    return _fold(torch.from_numpy(kernels.astype(np.float64))).numpy()


def force_map(displacement: np.ndarray, kernels: np.ndarray) -> np.ndarray:
    """Displacements (..., N, N) in mm and kernels to each pixel's force, (..., axes, N, N) in N."""
    half = kernels.shape[-1] // 2
    padding = [(0, 0)] * (displacement.ndim - 2) + [(half, half), (half, half)]
    shape = kernels.shape[-2:]
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(displacement, padding), shape, axis=(-2, -1))
    return np.einsum("...ijkl,aijkl->...aij", windows, kernels)
