"""The position-aware pixel network in floating point: (ΔB, ΔG, ΔR[, ΔNIR], x, y) to a surface normal.

A multi-layer perceptron, by default with layers of 16, 16, 16 and 3 neurons, applied to each pixel.
Source: Lu et al., "FasTac", section "Position-Aware MLP for Surface Normal Estimation".
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Self

import numpy as np
import torch
from torch import nn

from fastac.models.integer.features import HIDDEN, scales


class UnitLength(torch.nn.Module):
    """A module that scales vectors (…, 3) to unit length."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.normalize(x, dim=-1)


class PixelNetwork(nn.Module):
    """The network: features (pixels, channels + 2), scaled by `features.scales`, to normals (pixels, 3).

    The normals are not of unit length.
    """

    def __init__(self, inputs: int, hidden: tuple[int, ...] = HIDDEN):
        super().__init__()
        sizes = (inputs, *hidden)
        layers = []
        for a, b in pairwise(sizes):
            layers += [nn.Linear(a, b), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Linear(sizes[-1], 3))
        # Initially a surface that faces the camera: with n_z > 0 everywhere the slopes are finite.
        with torch.no_grad():
            self.layers[-1].bias.copy_(torch.tensor([0.0, 0.0, 1.0]))

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Self:
        """From `network.k.weight` (neurons, inputs) and `network.k.bias` of a bundle's float arrays."""
        count = sum(name.startswith("network.") and name.endswith(".weight") for name in arrays)
        weights = [torch.from_numpy(arrays[f"network.{k}.weight"]) for k in range(count)]
        network = cls(weights[0].shape[1], tuple(len(weight) for weight in weights[:-1]))
        with torch.no_grad():
            for k, (layer, weight) in enumerate(zip(network.linear_layers, weights, strict=True)):
                layer.weight.copy_(weight)
                layer.bias.copy_(torch.from_numpy(arrays[f"network.{k}.bias"]))
        return network

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """Copies of the weights and biases, as `from_arrays` takes them."""
        found = {}
        for k, layer in enumerate(self.linear_layers):
            found[f"network.{k}.weight"] = layer.weight.detach().numpy().copy()
            found[f"network.{k}.bias"] = layer.bias.detach().numpy().copy()
        return found

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.layers(x)

    @property
    def linear_layers(self) -> list[nn.Linear]:
        """The fully connected layers, in order."""
        return [layer for layer in self.layers if isinstance(layer, nn.Linear)]


def slopes_of(normal: np.ndarray, limit: float) -> np.ndarray:
    """Normals (..., 3) of any length to slopes p = −n_x/n_z, q = −n_y/n_z, (..., 2), clipped to ±limit.

    Where n_z ≤ 0 a slope is ±limit, with the sign of the component.
    """
    n_z = normal[..., 2:]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slopes = -normal[..., :2] / n_z
    slopes = np.where(n_z > 0, slopes, -np.sign(normal[..., :2]) * limit)
    return np.clip(np.nan_to_num(slopes, nan=0.0, posinf=limit, neginf=-limit), -limit, limit)


def predict(network: PixelNetwork, features: np.ndarray) -> np.ndarray:
    """Run the network on integer features (..., channels + 2); returns float64 normals (..., 3) of any
    length."""
    x = features.reshape(-1, features.shape[-1]).astype(np.float32)
    x *= scales(features.shape[-1] - 2).astype(np.float32)
    with torch.inference_mode():
        y = network(torch.from_numpy(x)).numpy()
    return y.reshape(*features.shape[:-1], 3).astype(np.float64)
