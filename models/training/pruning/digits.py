"""Baked weights and multipliers with fewer signed digits: each digit is an addition of the hardware.

Multipliers of requantisation are raised to the next of few digits where the error allows; a larger unit of
the weights makes up for it. Then weights are brought to their neighbours with one digit less, which for a
power of two is 0, where the slopes change least by it: estimated by the diagonal of the Gauss-Newton matrix,
as in Y. LeCun et al., "Optimal Brain Damage", NIPS 1989. Between rounds biases and the last layer are
fine-tuned bit-true, and multipliers that may have any digits.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.models.floating.network import PixelNetwork, slopes_of
from fastac.models.integer.network import Layer
from fastac.models.integer.quantise import MULTIPLIER_BITS
from fastac.models.training.bit_true import finetune
from fastac.scenes.training_schema import Training

JUDGED_PX = 1 << 14
"""Pixels from which the effects are estimated."""
ROUND_SHARE = 0.1
"""Share of all digits that the first round removes; halved where the error grows too much."""
SMALLEST_SHARE = 0.02
ROUND_EPOCHS = 2
MULTIPLIER_DIGITS = (2, 3, 4)
"""Digits of multipliers that are tried in turn."""
MULTIPLIER_EPOCHS = 4


def digit_counts(words: np.ndarray) -> np.ndarray:
    """Non-zero digits of each word's canonical signed-digit form."""
    magnitude = np.abs(words)
    return np.array([int(m).bit_count() for m in np.ravel(magnitude ^ (3 * magnitude))]).reshape(words.shape)


def with_short_multipliers(layers: Sequence[Layer], digits: int) -> tuple[Layer, ...]:
    """The layers with multipliers raised to the next that have at most so many signed digits, two or more,
    and with weights and biases that are smaller by as much."""
    every = np.arange(1 << MULTIPLIER_BITS)
    every = every[digit_counts(every) <= digits]
    hidden = []
    for layer in layers[:-1]:
        scale = layer.requantisation
        multiplier = every[np.searchsorted(every, scale.multiplier)]
        ratio = scale.multiplier / multiplier
        hidden.append(
            replace(
                layer,
                weight=np.rint(layer.weight * ratio[:, None]).astype(np.int64),
                bias=np.rint(layer.bias * ratio).astype(np.int64),
                requantisation=replace(scale, multiplier=multiplier),
            )
        )
    return (*hidden, layers[-1])


def one_digit_less(words: np.ndarray) -> np.ndarray:
    """Each word without the lowest digit of its canonical signed-digit form; 0 stays 0."""
    lowest = words & -words
    above = np.where(lowest == 0, 0, words // np.maximum(lowest, 1)) & 3
    return np.where(above == 3, words + lowest, words - lowest)


def slope_error(layers: Sequence[Layer], x: np.ndarray, y: np.ndarray, slope_limit: float) -> float:
    """Mean absolute error of both slopes together, features (pixels, inputs) against normals (pixels, 3)."""
    total = 0.0
    for start in range(0, len(x), 1 << 16):
        found, part = x[start : start + (1 << 16)].astype(np.int64), y[start : start + (1 << 16)]
        for layer in layers:
            found = layer(found)
        difference = slopes_of(found.astype(np.float64), slope_limit) - slopes_of(
            part.astype(np.float64), slope_limit
        )
        total += np.abs(difference).sum()
    return float(total / len(x))


def effects(layers: Sequence[Layer], x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each hidden layer the mean squared change of the slopes per squared change of a weight, (neurons,
    inputs), once the inputs' means (inputs,) are balanced by the bias; and those means."""
    inputs, slopes = [x.astype(np.int64)], []
    for layer in layers[:-1]:
        inputs.append(layer(inputs[-1]))
    normal = layers[-1](inputs[-1]).astype(np.float64)
    n_z = np.maximum(normal[:, 2], 1.0)
    by_normal = np.zeros((len(x), 2, 3))
    by_normal[:, 0, 0] = by_normal[:, 1, 1] = -1 / n_z
    by_normal[:, :, 2] = normal[:, :2] / n_z[:, None] ** 2
    sensitivity = by_normal @ layers[-1].weight
    for k in range(len(layers) - 2, -1, -1):
        scale, output = layers[k].requantisation, inputs[k + 1]
        varies = (output > 0) & (output < (1 << scale.bits) - 1)
        sensitivity *= (varies * scale.multiplier * 2.0**-scale.shift)[:, None]
        means = inputs[k].mean(axis=0)
        squared = (sensitivity**2).sum(axis=1)
        slopes.append((squared.T @ (inputs[k] - means) ** 2 / len(x), means))
        sensitivity = sensitivity @ layers[k].weight
    return slopes[::-1]


def fewer_weight_digits(layers: Sequence[Layer], x: np.ndarray, share: float) -> tuple[Layer, ...]:
    """Hidden weights with about `share` of their digits removed, at most one of each, those of least effect
    first; what the removed digits add on average over features x (pixels, inputs) goes into the biases."""
    found, less, costs = effects(layers, x), [], []
    for layer, (effect, _) in zip(layers[:-1], found, strict=True):
        less.append(one_digit_less(layer.weight))
        fixed = (layer.weight == 0) | (np.abs(less[-1]) > layer.weight_limit)
        costs.append(np.where(fixed, np.inf, effect * (less[-1] - layer.weight) ** 2))
    every = np.sort(np.concatenate([cost.ravel() for cost in costs]))
    total = sum(digit_counts(layer.weight).sum() for layer in layers[:-1])
    count = min(max(1, int(share * total)), np.isfinite(every).sum())
    highest = every[count - 1] if count else -1
    result = []
    for layer, (_, means), weight, cost in zip(layers[:-1], found, less, costs, strict=True):
        weight = np.where(cost <= highest, weight, layer.weight)
        bias = layer.bias + np.rint((layer.weight - weight) @ means).astype(np.int64)
        result.append(replace(layer, weight=weight, bias=np.clip(bias, -layer.bias_limit, layer.bias_limit)))
    return (*result, layers[-1])


def fewer_digits(
    pixels: dict[str, tuple[np.ndarray, np.ndarray]],
    layers: tuple[Layer, ...],
    network: PixelNetwork,
    settings: Training,
    *,
    growth: float,
    slope_limit: float,
    further_errors: Sequence[Callable[[Sequence[Layer]], float]] = (),
    progress: bool = False,
) -> tuple[Layer, ...]:
    """Layers with as few digits of multipliers and hidden weights as the error allows, fine-tuned.

    pixels : features and normals by split name, from `labelled_splits`; judged is the validation split or,
        where there is none, the train split
    layers : fine-tuned; what errors are compared with
    network : the float network that the layers were quantised from, the teacher
    growth : largest relative growth of the mean slope error
    further_errors : of layers, errors that must not grow by more either
    """
    judged = pixels.get("validation", pixels["train"])
    rng = np.random.default_rng(settings.seed)
    x = pixels["train"][0][rng.permutation(len(pixels["train"][0]))[:JUDGED_PX]]

    def errors(candidate: Sequence[Layer]) -> np.ndarray:
        found = [slope_error(candidate, *judged, slope_limit)]
        return np.array([*found, *(error(candidate) for error in further_errors)])

    def tuned(candidate: tuple[Layer, ...], epochs: int, *, multipliers: bool) -> tuple[Layer, ...]:
        found, _ = finetune(
            pixels,
            candidate,
            network,
            settings,
            epochs=min(epochs, settings.finetune_epochs),
            hidden_weights=False,
            multipliers=multipliers,
            progress=progress,
        )
        return found

    with threadpool_limits(1):  # sums over more threads depend on the machine
        limits, multipliers, share = (1 + growth) * errors(layers), True, ROUND_SHARE
        for digits in MULTIPLIER_DIGITS:
            short = with_short_multipliers(layers, digits)
            candidate = tuned(short, MULTIPLIER_EPOCHS, multipliers=False)
            if (errors(candidate) <= limits).all():
                layers, multipliers = candidate, False
                break
        while share >= SMALLEST_SHARE:
            fewer = fewer_weight_digits(layers, x, share)
            if not any((a.weight != b.weight).any() for a, b in zip(fewer, layers, strict=True)):
                break
            candidate = tuned(fewer, ROUND_EPOCHS, multipliers=multipliers)
            if (errors(candidate) <= limits).all():
                layers = candidate
            else:
                share /= 2
    return layers
