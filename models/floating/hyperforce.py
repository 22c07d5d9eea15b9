"""HyperForce: the force as a convolution with position-dependent kernels from a hypernetwork.

F = Σ_p w(c(p)) · v(p), where the hypernetwork w gives a K×K kernel for the normalised 3-D coordinate c(p) of
pixel p, and v(p) is the K×K patch of the displacement around p, zero outside the inner pixels.
Source: Lu et al., "FasTac", section "FEM-inspired Dynamic Convolution Network".
"""

import numpy as np
import torch
from torch import nn


def coordinates(rest_depth: np.ndarray) -> np.ndarray:
    """Normalised 3-D coordinates x, y, z in −1 … 1, (N, N, 3), from the undeformed skin's depth (N, N)."""
    n = len(rest_depth)
    line = np.linspace(-1, 1, n)
    low, high = rest_depth.min(), rest_depth.max()
    z = 2 * (rest_depth - low) / (high - low) - 1 if high > low else np.zeros_like(rest_depth)
    return np.stack([np.broadcast_to(line, (n, n)), np.broadcast_to(line[:, None], (n, n)), z], axis=-1)


class HyperForce(nn.Module):
    """The model of `axes` force components from the normal displacement; the hypernetwork is `layers`.

    coordinate : (N, N, 3), see `coordinates`; kernel_size : K; hidden : neurons of the hypernetwork's layers
    """

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
        """The kernels of all inner pixels, (axes, N, N, K, K) in N per mm."""
        k = self.kernel_size
        weights = self.layers(self.coordinate) * self.unit
        return weights.reshape(self.size, self.size, self.axes, k, k).permute(2, 0, 1, 3, 4)

    def set_force_unit(self, displacement: torch.Tensor, force_n: torch.Tensor) -> None:
        """Set the kernels' unit so that network outputs of order one give forces of the order of `force_n`.

        displacement : (frames, …) in mm; force_n : (frames, axes)
        """
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
    """Collapse kernels (axes, N, N, K, K) to one weight per pixel, (axes, N, N), for the resultant force.

    Exact: the sums over pixels and over the offsets in a patch are exchanged, so that the resultant is
    Σ weight · displacement.
    """
    return _fold(torch.from_numpy(kernels.astype(np.float64))).numpy()


def force_map(displacement: np.ndarray, kernels: np.ndarray) -> np.ndarray:
    """Force of each pixel, (..., axes, N, N) in N, from displacements (..., N, N) in mm and kernels
    (axes, N, N, K, K) in N per mm."""
    half = kernels.shape[-1] // 2
    padding = [(0, 0)] * (displacement.ndim - 2) + [(half, half), (half, half)]
    shape = kernels.shape[-2:]
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(displacement, padding), shape, axis=(-2, -1))
    return np.einsum("...ijkl,aijkl->...aij", windows, kernels)
