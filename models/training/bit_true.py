"""Quantisation-aware fine-tuning: the forward pass is the integer arithmetic itself."""

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork, UnitLength
from fastac.models.integer.features import scales
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.training.normals import Fit, ScaledNetwork, _tensors
from fastac.scenes.model_schema import Training


class _Requantise(torch.autograd.Function):
    """`Requantisation` of whole accumulators (neurons, pixels), exactly.

    Gradients are those of a · multiplier · 2**−shift within its range. One function in place of its parts:
    memory is what limits them, and each would write its results there.
    """

    @staticmethod
    def forward(ctx, a: torch.Tensor, multiplier: torch.Tensor, scale: Requantisation) -> torch.Tensor:
        ctx.unit, ctx.top = 2.0**-scale.shift, (1 << scale.bits) - 1
        ctx.save_for_backward(a, multiplier, a * (multiplier * ctx.unit))
        # Accumulators stay below 2**24, so float32 holds them exactly; their products do not.
        product = a.double().mul_(multiplier.round().double() * ctx.unit)
        return product.floor_().clamp_(0, ctx.top).float()

    @staticmethod
    def backward(ctx, gradient: torch.Tensor):
        a, multiplier, smooth = ctx.saved_tensors
        passed = torch.ops.aten.hardtanh_backward(gradient, smooth, 0, ctx.top)
        of_multiplier = None
        if ctx.needs_input_grad[1]:
            of_multiplier = (passed * a).sum(dim=1, keepdim=True) * ctx.unit
        return passed.mul_(multiplier * ctx.unit), of_multiplier, None


class BitTrueNetwork(torch.nn.Module):
    """The integer layers as a network: forward exact, gradients straight through the roundings.

    Weights are kept in units of their last place, biases in `BIAS_UNIT`s of theirs, multipliers as logarithms
    in `1/LOG_UNIT`: steps of one size then mean about as much in each. All are rounded on every use. With
    hidden_weights False the hidden layers' weights stay as they are.
    """

    BIAS_UNIT, LOG_UNIT = 16, 2000

    def __init__(self, layers: tuple[Layer, ...], *, hidden_weights: bool = True):
        super().__init__()

        def parameters(arrays) -> torch.nn.ParameterList:
            return torch.nn.ParameterList(torch.tensor(np.asarray(x), dtype=torch.float32) for x in arrays)

        self.layers = layers
        self.weights = parameters(layer.weight for layer in layers)
        for weight in self.weights[:-1]:
            weight.requires_grad = hidden_weights
        self.biases = parameters(layer.bias / self.BIAS_UNIT for layer in layers)
        scales = [layer.requantisation for layer in layers[:-1]]
        self.multipliers = parameters(np.log(scale.multiplier) * self.LOG_UNIT for scale in scales)
        # The last layer's words may be long: half of float32's 24 bits for the products, half for the bias.
        top = (1 << (layers[-1].weight_bits - 1)) - 1
        self.last_type = torch.float32 if top * layers[-1].input_limit.sum() < 1 << 23 else torch.float64

    def _integers(self, index: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Weights and biases of a layer, rounded, with gradients."""
        layer = self.layers[index]
        weight = self.weights[index].clamp(-layer.weight_limit, layer.weight_limit)
        bias = (self.biases[index] * self.BIAS_UNIT).clamp(-layer.bias_limit, layer.bias_limit)
        return weight + (weight.round() - weight).detach(), bias + (bias.round() - bias).detach()

    def _multiplier(self, index: int) -> torch.Tensor:
        return torch.exp(self.multipliers[index] / self.LOG_UNIT).clamp(1, (1 << 17) - 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Integer features (pixels, inputs), float32, to the last layer's integers, float32 or float64."""
        x = x.round().T  # a row a neuron: what is one number a neuron then meets whole rows
        for index, layer in enumerate(self.layers[:-1]):
            weight, bias = self._integers(index)
            a = torch.addmm(bias[:, None], weight, x)
            x = _Requantise.apply(a, self._multiplier(index)[:, None], layer.requantisation)
        weight, bias = (part.to(self.last_type) for part in self._integers(len(self.layers) - 1))
        return torch.addmm(bias[:, None], weight, x.to(self.last_type)).T

    def quantised(self) -> tuple[Layer, ...]:
        """The layers with the integers learned so far."""
        result = []
        for index, layer in enumerate(self.layers):
            weight, bias = (t.detach().numpy().round().astype(np.int64) for t in self._integers(index))
            scale = layer.requantisation
            if scale is not None:
                multiplier = self._multiplier(index).detach().numpy().round().astype(np.int64)
                scale = Requantisation(multiplier, scale.shift, scale.bits)
            result.append(Layer(weight, bias, layer.input_limit, layer.weight_bits, scale))
        return tuple(result)


def finetune(
    pixels: dict[str, tuple[np.ndarray, np.ndarray]],
    layers: tuple[Layer, ...],
    network: PixelNetwork,
    settings: Training,
    *,
    progress: bool = False,
) -> tuple[tuple[Layer, ...], list[dict]]:
    """Bit-true fine-tuning of quantised layers; returns the tuned layers and the learning curve.

    pixels : features and normals by split name, as of `labelled`
    network : the float network that the layers were quantised from; it teaches the integers. The labels would
        also teach them, but with their noise, which moves the integers by more than the quantisation does.

    At 8 bits the hidden weights are best left alone (`settings.finetune_weights`): they hop between two
    neighbouring integers on every step, and where they stop is chance. Biases, multipliers and the wide last
    layer have steps fine enough to be learned.
    """
    if not settings.finetune_epochs:
        return layers, []
    x, y = pixels["train"]
    teacher = torch.nn.Sequential(ScaledNetwork(network, scales(x.shape[1] - 2)), UnitLength())
    model = BitTrueNetwork(layers, hidden_weights=settings.finetune_weights)
    history = Fit(
        settings.finetune_epochs,
        settings.normals_batch_px,
        settings.finetune_learning_rate,
        settings.seed + 1,
        "normals, bit-true",
        0.0,
        settings.input_noise,
        settings.position_noise,
    )(
        model,
        x,
        y,
        validation=_tensors(pixels),
        teacher=teacher,
        progress=progress,
    )
    return model.quantised(), history
