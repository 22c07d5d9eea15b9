"""The force from a frame's pixels: pixel network, slopes, and their weighted sum, on averaged frames.

Frames are averaged over blocks, which is faster and loses little since contacts are smooth.
"""

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import coordinate_codes, scales
from fastac.models.training.force import smooth_weights

MIN_BLOCKS = 20
"""Smallest side of block-averaged frames, in blocks: time goes with their number. With 10 × 11 for 40 × 44 px
the error grew by a seventh."""
MIN_N_Z = 1e-2


def block_size(height: int, width: int) -> int:
    """Side in px of the blocks over which frames are averaged: the largest power of two that divides the
    image and leaves MIN_BLOCKS blocks along each side."""
    block = 1
    while not (height % (2 * block) or width % (2 * block) or min(height, width) // (2 * block) < MIN_BLOCKS):
        block *= 2
    return block


def block_averages(images: np.ndarray, block: int) -> np.ndarray:
    """Images (..., H, W, terms) averaged over blocks, (..., H / block, W / block, terms)."""
    *outer, height, width, terms = images.shape
    split = images.reshape(*outer, height // block, block, width // block, block, terms)
    return split.mean(axis=(-4, -2))


class ForceFromPixels(torch.nn.Module):
    """The force from differences to the background: pixel network, slopes, and their weighted sum."""

    def __init__(self, network: PixelNetwork, fields: np.ndarray, shape: tuple[int, int, int], limit: float):
        """fields : (axes, m, m, 2), DCT coefficients of the slopes' weights in N
        shape : (H, W, C) of the frames; limit : the largest |slope|
        """
        super().__init__()
        height, width, channels = shape
        block = block_size(height, width)
        self.network, self.limit = network, limit
        self.unit = float(np.abs(fields).mean()) * block**2
        self.fields = torch.nn.Parameter(torch.tensor(fields * block**2 / self.unit, dtype=torch.float32))
        codes = np.stack(np.meshgrid(coordinate_codes(width), coordinate_codes(height)), axis=-1)
        buffers = {"codes": block_averages(codes, block), "scales": scales(channels)}
        for name, size in (("rows", height), ("columns", width)):
            buffers[name] = (
                smooth_weights.cosine_basis(size, fields.shape[1]).reshape(-1, block, fields.shape[1]).mean(1)
            )
        for name, values in buffers.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    def slopes(self, features: torch.Tensor) -> torch.Tensor:
        normal = self.network(features * self.scales)
        slopes = -normal[..., :2] / normal[..., 2:].clamp(min=MIN_N_Z)
        return slopes.clamp(-self.limit, self.limit)

    def slope_changes(self, change: torch.Tensor) -> torch.Tensor:
        """Averaged differences (frames, H / block, W / block, C), float32, to slopes less those at rest."""
        change = torch.cat([change, torch.zeros_like(change[:1])])  # last: the background, with no difference
        codes = self.codes.expand(*change.shape[:3], 2)
        slopes = self.slopes(torch.cat([change, codes], dim=-1))
        return slopes[:-1] - slopes[-1:]

    def force_n(self, slopes: torch.Tensor) -> torch.Tensor:
        """What `slope_changes` returns, to forces (frames, axes) in N."""
        weights = torch.einsum("ik,jl,aklt->aijt", self.rows, self.columns, self.fields * self.unit)
        return torch.einsum("nijt,aijt->na", slopes, weights)

    def forward(self, change: torch.Tensor) -> torch.Tensor:
        """Averaged differences, as in `slope_changes`, to forces (frames, axes) in N."""
        return self.force_n(self.slope_changes(change))
