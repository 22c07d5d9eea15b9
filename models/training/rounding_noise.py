"""Rounding of hidden activations as noise, while the float network is trained.

A network that has felt the noise keeps small what is rounded most coarsely, and spreads what matters over
several neurons. Source: Défossez, Adi, Synnaeve, "Differentiable Model Compression via Pseudo Quantization
Noise", arXiv:2104.09987, who do so with weights.
"""

import torch

from fastac.models.floating.network import PixelNetwork


class RoundingNoise(torch.nn.Module):
    """The pixel network, whose hidden activations are off by up to half a unit of `bits` while it is trained.

    A neuron's unit is its largest activation in the batch over the largest word, as in
    models/integer/quantise.py. Gradients pass through that largest activation, too. In evaluation mode it is
    the network itself.
    """

    def __init__(self, network: PixelNetwork, bits: int):
        super().__init__()
        self.network, self.top = network, (1 << bits) - 1

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Scaled features (..., inputs) to normals (..., 3)."""
        if not self.training:
            return self.network(x)
        *hidden, last = self.network.linear_layers
        for layer in hidden:
            x = torch.relu(layer(x))
            unit = x.flatten(0, -2).amax(dim=0) / self.top
            x = x + (torch.rand_like(x) - 0.5) * unit
        return last(x)


def with_rounding_noise(network: PixelNetwork, bits: int | None) -> torch.nn.Module:
    """The network in RoundingNoise; without `bits` the network itself."""
    return network if bits is None else RoundingNoise(network, bits)
