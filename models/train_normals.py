"""Training the pixel network: in floating point, then bit-true.

Bit-true fine-tuning runs the integer arithmetic of models/integer.py forward, and passes gradients straight
through its roundings; what it optimises is exactly what the hardware computes.
"""

from collections.abc import Iterator

import numpy as np
import torch
from tqdm import tqdm

from fastac.scene import Training
from sensor.dataset import Dataset

from .features import integer_features, scales
from .integer import Layer, Requantisation
from .normals import PixelNetwork, normal_loss


def labelled_pixels(
    data: Dataset, split: str, *, flat_fraction: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """All pixels of a split whose normal is known: features (pixels, inputs), normals (pixels, 3).

    flat_fraction : where the background itself is among the frames, keep as many of its pixels that they are
    this share of the result (all of them if 0). Raises ValueError where there is nothing to learn from.
    """
    if data.normals is None:
        raise ValueError("normals: missing, so there is nothing to train the pixel network on")
    contact, flat = [], []
    for index in data.indices(split):
        known = np.ones(data.frames.shape[1:3], bool) if data.valid is None else data.valid[index]
        features = integer_features(data.frames[index], data.background)[known]
        at_rest = np.array_equal(data.frames[index], data.background)
        (flat if at_rest else contact).append((features, data.normals[index][known].astype(np.float32)))
    if not contact:
        raise ValueError(f"split: no frame in contact is in {split!r}")
    x, y = (np.concatenate(parts) for parts in zip(*contact, strict=True))
    if flat:
        flat_x, flat_y = (np.concatenate(parts) for parts in zip(*flat, strict=True))
        if flat_fraction:
            count = min(len(flat_x), int(len(x) * flat_fraction / (1 - flat_fraction)))
            chosen = np.random.default_rng(seed).choice(len(flat_x), count, replace=False)
            flat_x, flat_y = flat_x[chosen], flat_y[chosen]
        x, y = np.concatenate([x, flat_x]), np.concatenate([y, flat_y])
    return x, y


def _batches(count: int, size: int, generator: torch.Generator) -> Iterator[torch.Tensor]:
    order = torch.randperm(count, generator=generator)
    yield from order.split(size)


def _fit(
    model, parameters, x, y, *, epochs, batch, rate, noise, seed, validation, progress, label
) -> list[dict]:
    """Adam with a cosine schedule on the paper's loss; leaves the best weights on validation in the model."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # layers this small lose more to handing work over than they gain
    try:
        return _epochs(model, parameters, x, y, epochs, batch, rate, noise, seed, validation, progress, label)
    finally:
        torch.set_num_threads(threads)


def _epochs(
    model, parameters, x, y, epochs, batch, rate, noise, seed, validation, progress, label
) -> list[dict]:
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    x, y = torch.from_numpy(x.astype(np.float32)), torch.from_numpy(y)
    optimiser = torch.optim.Adam(parameters, lr=rate)
    steps = epochs * -(-len(x) // batch)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    spread = x.std(dim=0)
    spread[-2:] = 0  # a pixel knows where it is
    best, best_state, history = np.inf, None, []
    bar = tqdm(total=steps, desc=label, unit="step", disable=not progress, leave=False)
    for epoch in range(epochs):
        total = 0.0
        for index in _batches(len(x), batch, generator):
            inputs = x[index]
            if noise:
                inputs = inputs + noise * spread * torch.randn(inputs.shape, generator=generator)
            loss = normal_loss(model(inputs), y[index])
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item() * len(index)
            bar.update()
        entry = {"epoch": epoch + 1, "train_loss": total / len(x)}
        if validation is not None:
            with torch.inference_mode():
                chunks = zip(validation[0].split(1 << 16), validation[1].split(1 << 16), strict=True)
                sums = [normal_loss(model(a), b).item() * len(a) for a, b in chunks]
            entry["validation_loss"] = sum(sums) / len(validation[0])
            if entry["validation_loss"] < best:
                best = entry["validation_loss"]
                best_state = {k: v.clone() for k, v in model.state_dict().items()}
        history.append(entry)
        bar.set_postfix(loss=f"{entry.get('validation_loss', entry['train_loss']):.4f}")
    bar.close()
    if best_state is not None:
        model.load_state_dict(best_state)
    return history


class ScaledNetwork(torch.nn.Module):
    """The float network on integer features."""

    def __init__(self, network: PixelNetwork, feature_scales: np.ndarray):
        super().__init__()
        self.network = network
        self.register_buffer("scales", torch.tensor(feature_scales, dtype=torch.float32))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.network(x * self.scales)


def _validation(data: Dataset, limit: int, seed: int):
    """A fixed sample of the validation split's pixels as tensors, or None where there is no such split."""
    if not len(data.indices("validation")):
        return None
    x, y = labelled_pixels(data, "validation")
    chosen = np.random.default_rng(seed).permutation(len(x))[:limit]
    return torch.from_numpy(x[chosen].astype(np.float32)), torch.from_numpy(y[chosen])


def train(data: Dataset, settings: Training, *, progress: bool = False) -> tuple[PixelNetwork, list[dict]]:
    """Fit the float network to a dataset's train split; returns it and its learning curve."""
    x, y = labelled_pixels(data, "train", flat_fraction=settings.flat_fraction, seed=settings.seed)
    torch.manual_seed(settings.seed)
    network = PixelNetwork(x.shape[1])
    model = ScaledNetwork(network, scales(x.shape[1] - 2))
    history = _fit(
        model,
        network.parameters(),
        x,
        y,
        epochs=settings.normals_epochs,
        batch=settings.normals_batch_px,
        rate=settings.normals_learning_rate,
        noise=settings.input_noise,
        seed=settings.seed,
        validation=_validation(data, 1 << 18, settings.seed),
        progress=progress,
        label="normals, float",
    )
    return network, history


class BitTrueNetwork(torch.nn.Module):
    """The integer layers as a network: forward exact, gradients straight through the roundings.

    Weights are kept in units of their last place, biases in `BIAS_UNIT`s of theirs, multipliers as logarithms
    in `1/LOG_UNIT`: steps of one size then mean about as much in each. All are rounded on every use.
    """

    BIAS_UNIT, LOG_UNIT = 64, 50

    def __init__(self, layers: tuple[Layer, ...]):
        super().__init__()

        def parameters(arrays) -> torch.nn.ParameterList:
            return torch.nn.ParameterList(torch.tensor(np.asarray(x), dtype=torch.float32) for x in arrays)

        self.layers = layers
        self.weights = parameters(layer.weight for layer in layers)
        self.biases = parameters(layer.bias / self.BIAS_UNIT for layer in layers)
        scales = [layer.requantisation for layer in layers[:-1]]
        self.multipliers = parameters(np.log(scale.multiplier) * self.LOG_UNIT for scale in scales)

    def _integers(self, index: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Weights and biases of a layer, rounded, with gradients."""
        top = (1 << (self.layers[index].weight_bits - 1)) - 1
        weight = self.weights[index].clamp(-top, top)
        bias = self.biases[index] * self.BIAS_UNIT
        return weight + (weight.round() - weight).detach(), bias + (bias.round() - bias).detach()

    def _multiplier(self, index: int) -> torch.Tensor:
        return torch.exp(self.multipliers[index] / self.LOG_UNIT).clamp(1, (1 << 17) - 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Integer features (pixels, inputs), float32, to the last layer's integers, float32."""
        x = x.round()
        for index, layer in enumerate(self.layers[:-1]):
            weight, bias = self._integers(index)
            # Accumulators stay far below 2**24, so float32 holds them exactly; their products do not.
            a = x @ weight.T + bias
            scale, multiplier = layer.requantisation, self._multiplier(index)
            top = (1 << scale.bits) - 1
            smooth = (a * (multiplier * 2.0**-scale.shift)).clamp(0, top)
            product = a.detach().clamp(min=0).double() * multiplier.detach().round().double()
            exact = (product * 2.0**-scale.shift).floor().clamp(max=top)
            x = smooth + (exact.float() - smooth).detach()
        weight, bias = self._integers(len(self.layers) - 1)
        return x @ weight.T + bias

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
    data: Dataset, layers: tuple[Layer, ...], settings: Training, *, progress: bool = False
) -> tuple[tuple[Layer, ...], list[dict]]:
    """Bit-true fine-tuning of quantised layers; returns the tuned layers and the learning curve."""
    if not settings.finetune_epochs:
        return layers, []
    x, y = labelled_pixels(data, "train", flat_fraction=settings.flat_fraction, seed=settings.seed)
    model = BitTrueNetwork(layers)
    history = _fit(
        model,
        model.parameters(),
        x,
        y,
        epochs=settings.finetune_epochs,
        batch=settings.normals_batch_px,
        rate=settings.finetune_learning_rate,
        noise=settings.input_noise,
        seed=settings.seed + 1,
        validation=_validation(data, 1 << 18, settings.seed),
        progress=progress,
        label="normals, bit-true",
    )
    return model.quantised(), history
