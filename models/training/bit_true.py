"""Quantisation-aware fine-tuning of the pixel network: the forward pass is the hardware's integer arithmetic.

Gradients pass the roundings by the straight-through estimator (Bengio, Léonard, Courville, arXiv:1308.3432).
"""

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork, UnitLength
from fastac.models.integer.features import scales
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.training.normals import Fit, ScaledNetwork, _tensors
from fastac.scenes.training_schema import Training


class _Requantise(torch.autograd.Function):
    """Exact `Requantisation` of accumulators (neurons, pixels), with a straight-through gradient.

    The gradient is that of a · multiplier · 2**−shift, clipped to the activations' range. It is one autograd
    function instead of several operations because memory bandwidth limits it: each operation would write its
    result to memory.
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
    """The integer layers as a trainable network: an exact forward pass and straight-through gradients.

    The parameters are weights in units of their last place, biases in units of BIAS_UNIT last places, and
    logarithms of the multipliers times LOG_UNIT, so that one learning rate suits them all. Each is rounded
    whenever it is used. With hidden_weights False the weights of the hidden layers are not trained, with
    multipliers False their multipliers.
    """

    BIAS_UNIT, LOG_UNIT = 16, 2000

    def __init__(self, layers: tuple[Layer, ...], *, hidden_weights: bool = True, multipliers: bool = True):
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
        for multiplier in self.multipliers:
            multiplier.requires_grad = multipliers
        # The last layer's words may be long: half of float32's 24 bits for the products, half for the bias.
        top = (1 << (layers[-1].weight_bits - 1)) - 1
        self.last_type = torch.float32 if top * layers[-1].input_limit.sum() < 1 << 23 else torch.float64

    def _integers(self, index: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Rounded weights and biases of a layer, with straight-through gradients."""
        layer = self.layers[index]
        weight = self.weights[index].clamp(-layer.weight_limit, layer.weight_limit)
        bias = (self.biases[index] * self.BIAS_UNIT).clamp(-layer.bias_limit, layer.bias_limit)
        return weight + (weight.round() - weight).detach(), bias + (bias.round() - bias).detach()

    def _multiplier(self, index: int) -> torch.Tensor:
        return torch.exp(self.multipliers[index] / self.LOG_UNIT).clamp(1, (1 << 17) - 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Integer features (pixels, inputs), float32, to the last layer's integers, (pixels, 3), as
        floats."""
        x = x.round().T  # one row per neuron, so that per-neuron factors multiply contiguous rows
        for index, layer in enumerate(self.layers[:-1]):
            weight, bias = self._integers(index)
            a = torch.addmm(bias[:, None], weight, x)
            x = _Requantise.apply(a, self._multiplier(index)[:, None], layer.requantisation)
        weight, bias = (part.to(self.last_type) for part in self._integers(len(self.layers) - 1))
        return torch.addmm(bias[:, None], weight, x.to(self.last_type)).T

    def quantised(self) -> tuple[Layer, ...]:
        """The layers with the present, rounded parameters."""
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
    epochs: int | None = None,
    hidden_weights: bool | None = None,
    multipliers: bool = True,
    progress: bool = False,
) -> tuple[tuple[Layer, ...], list[dict]]:
    """Bit-true fine-tuning of quantised layers; returns the tuned layers and the learning curve.

    pixels : features and normals by split name, from `labelled_splits`
    network : the float network that the layers were quantised from, used as the teacher: its outputs are the
        targets, because the noise of the labels would move the integers by more than quantisation does
    epochs, hidden_weights : in place of those of `settings`; multipliers : whether they are tuned

    At 8 bits the hidden weights should stay fixed (`settings.finetune_weights` false): they jump between two
    neighbouring integers on every step, and end on either at random. Biases, multipliers and the wider words
    of the last layer have steps fine enough to be trained.
    """
    epochs = settings.finetune_epochs if epochs is None else epochs
    hidden_weights = settings.finetune_weights if hidden_weights is None else hidden_weights
    if not epochs:
        return layers, []
    x, y = pixels["train"]
    teacher = torch.nn.Sequential(ScaledNetwork(network, scales(x.shape[1] - 2)), UnitLength())
    model = BitTrueNetwork(layers, hidden_weights=hidden_weights, multipliers=multipliers)
    history = Fit.of(
        settings,
        "normals, bit-true",
        epochs=epochs,
        rate=settings.finetune_learning_rate,
        seed=settings.seed + 1,
        patience=settings.patience_epochs,
    )(
        model,
        x,
        y,
        validation=_tensors(pixels),
        teacher=teacher,
        progress=progress,
    )
    return model.quantised(), history
