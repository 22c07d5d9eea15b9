"""Rounding of hidden activations and weights as noise, while the float network is trained.

A network that has felt the noise keeps small what is rounded most coarsely, and spreads what matters over
several neurons. Source: Défossez, Adi, Synnaeve, "Differentiable Model Compression via Pseudo Quantization
Noise", arXiv:2104.09987, who do so with weights.
"""

import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import scales
from fastac.models.integer.quantise import least_range


class RoundingNoise(torch.nn.Module):
    """The pixel network, whose hidden layers are off by up to half a unit of the integers that they become,
    while it is trained. In evaluation mode it is the network itself.

    activation_bits : of the hidden activations; a neuron's unit is its largest activation in the batch over
        the largest word. Gradients pass through that largest activation, too
    weight_bits : of the hidden layers' weights; a neuron's unit is its largest weight, times what one unit of
        its input is, over the largest word

    Units are those of models/integer/quantise.py. Without bits there is no noise.
    """

    def __init__(
        self, network: PixelNetwork, activation_bits: int | None = None, weight_bits: int | None = None
    ):
        super().__init__()
        self.network, self.activation_bits, self.weight_bits = network, activation_bits, weight_bits
        channels = network.linear_layers[0].in_features - 2
        self.register_buffer("feature_scales", torch.from_numpy(scales(channels)).float())

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Scaled features (..., inputs) to normals (..., 3)."""
        if not self.training:
            return self.network(x)
        *hidden, last = self.network.linear_layers
        unit = self.feature_scales
        for layer in hidden:
            weight = layer.weight
            if self.weight_bits is not None:
                weight = weight + _half_a_unit(weight_units(weight.detach(), unit, self.weight_bits))
            x = torch.relu(torch.nn.functional.linear(x, weight, layer.bias))
            largest = x.flatten(0, -2).amax(dim=0)
            # All activations have as many words, so that their number cancels out of the weights' units.
            unit = largest.detach()
            if self.activation_bits is not None:
                x = x + _half_a_unit((largest / ((1 << self.activation_bits) - 1)).expand_as(x))
        return last(x)


def weight_units(weight: torch.Tensor, input_unit: torch.Tensor, bits: int) -> torch.Tensor:
    """What one unit of each integer weight is as a float, (neurons, inputs), with as many `bits`.

    weight : (neurons, inputs); input_unit : what one unit of each input is, (inputs,), to a common factor
    """
    input_unit = input_unit.clamp_min(least_range(input_unit))
    largest = (weight * input_unit).abs().amax(dim=1, keepdim=True)
    return largest / ((1 << (bits - 1)) - 1) / input_unit


def _half_a_unit(unit: torch.Tensor) -> torch.Tensor:
    """Noise between minus and plus half of the units, of their shape."""
    return (torch.rand_like(unit) - 0.5) * unit


def with_rounding_noise(
    network: PixelNetwork, activation_bits: int | None, weight_bits: int | None = None
) -> torch.nn.Module:
    """The network in RoundingNoise; without any bits the network itself."""
    if activation_bits is None and weight_bits is None:
        return network
    return RoundingNoise(network, activation_bits, weight_bits)
