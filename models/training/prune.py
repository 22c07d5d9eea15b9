"""Pruning of the float pixel network: hidden neurons are removed in the order of their least effect.

A neuron's outputs are replaced by the best linear combination of its layer's other outputs, which goes into
the next layer's weights and biases; then the network is trained on. Where the error has grown too much, the
network before that neuron is what is kept.
"""

from collections.abc import Callable, Iterator

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from fastac.models.floating.network import PixelNetwork, predict, slopes_of
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import scales
from fastac.models.training.normals import Fit, ScaledNetwork, _tensors
from fastac.scenes.model_schema import FEWEST_NEURONS, Training

JUDGED_PX = 1 << 14
"""Pixels on which the neurons' effects are compared."""
COMBINED_PX = 1 << 16
"""Pixels from which a neuron's linear combination is found."""
TRIES = 2
"""Neurons that are tried in turn, those of least effect, before nothing more is removed."""
TUNING_SHARE = 0.2
"""Epochs after each neuron, as a share of the float network's."""
NO_EFFECT = 1e-4
"""Relative growth of the error up to which a neuron counts as without effect: nothing is trained after it."""


def gradient_error(network: PixelNetwork, x: np.ndarray, y: np.ndarray, slope_limit: float) -> float:
    """Mean absolute error of both slopes together, features (pixels, inputs) against normals (pixels, 3)."""
    truth = slopes_of(y.astype(np.float64), slope_limit)
    return float(np.abs(slopes_of(predict(network, x), slope_limit) - truth).sum(axis=1).mean())


def outputs(network: PixelNetwork, x: np.ndarray) -> list[np.ndarray]:
    """Each hidden layer's outputs (pixels, neurons) for features (pixels, inputs)."""
    found = []
    with torch.inference_mode():
        values = torch.from_numpy(x.astype(np.float32) * scales(x.shape[1] - 2).astype(np.float32))
        for layer in network.linear_layers[:-1]:
            values = torch.relu(layer(values))
            found.append(values.numpy().astype(np.float64))
    return found


def widths(network: PixelNetwork) -> tuple[int, ...]:
    """Neurons of each hidden layer."""
    return tuple(layer.out_features for layer in network.linear_layers[:-1])


def without_neuron(network: PixelNetwork, index: int, neuron: int, hidden: np.ndarray) -> PixelNetwork:
    """The network without one neuron of hidden layer `index`, whose outputs are `hidden` (pixels, all)."""
    others = np.delete(hidden, neuron, axis=1)
    known = np.column_stack([others, np.ones(len(others))])
    share, *_ = np.linalg.lstsq(known.T @ known, known.T @ hidden[:, neuron], rcond=1e-9)
    sizes = list(widths(network))
    sizes[index] -= 1
    found = PixelNetwork(network.linear_layers[0].in_features, tuple(sizes))
    kept = [k for k in range(hidden.shape[1]) if k != neuron]
    with torch.no_grad():
        for k, (new, old) in enumerate(zip(found.linear_layers, network.linear_layers, strict=True)):
            weight, bias = old.weight, old.bias
            if k == index:
                weight, bias = weight[kept], bias[kept]
            elif k == index + 1:
                column = weight[:, neuron]
                bias = bias + column * float(share[-1])
                weight = weight[:, kept] + torch.outer(column, torch.tensor(share[:-1], dtype=weight.dtype))
            new.weight.copy_(weight)
            new.bias.copy_(bias)
    return found


def candidates(network: PixelNetwork, x: np.ndarray) -> Iterator[PixelNetwork]:
    """The network without one neuron, for every hidden neuron of a layer with more than FEWEST_NEURONS.

    x : features (pixels, inputs) from which the linear combinations are found
    """
    for index, hidden in enumerate(outputs(network, x)):
        for neuron in range(hidden.shape[1] if hidden.shape[1] > FEWEST_NEURONS else 0):
            yield without_neuron(network, index, neuron, hidden)


def prune_neurons(
    network: PixelNetwork,
    pixels: dict[str, tuple[np.ndarray, np.ndarray]],
    settings: Training,
    *,
    growth: float,
    slope_limit: float,
    further_error: Callable[[PixelNetwork], float] | None = None,
    progress: bool = False,
) -> PixelNetwork:
    """The network with as few hidden neurons as the error allows; `network` itself is not changed.

    pixels : features and normals by split name, from `labelled_splits`; judged is the validation split or,
        where there is none, the train split
    growth : largest relative growth of the mean slope error of `network`
    slope_limit : magnitude at which slopes are clipped
    further_error : of a network, an error that must not grow by more either

    The same for the same pixels and `settings.seed`.
    """
    judged = pixels.get("validation", pixels["train"])
    rng = np.random.default_rng(settings.seed)
    few = rng.permutation(len(judged[0]))[:JUDGED_PX]
    known = rng.permutation(len(pixels["train"][0]))[:COMBINED_PX]

    def error(candidate: PixelNetwork) -> float:
        return gradient_error(candidate, judged[0][few], judged[1][few], slope_limit)

    def errors(candidate: PixelNetwork) -> np.ndarray:
        found = [gradient_error(candidate, *judged, slope_limit)]
        return np.array(found if further_error is None else [*found, further_error(candidate)])

    def trained_on(candidate: PixelNetwork) -> PixelNetwork:
        fit = Fit(
            max(1, round(TUNING_SHARE * settings.normals_epochs)),
            settings.normals_batch_px,
            settings.normals_learning_rate,
            settings.seed,
            f"normals, {'-'.join(map(str, widths(candidate)))}",
            0.0,
            settings.input_noise,
            settings.position_noise,
        )
        model = ScaledNetwork(candidate, scales(candidate.linear_layers[0].in_features - 2))
        fit(model, *pixels["train"], validation=_tensors(pixels), progress=progress)
        return candidate

    # Small products are slower on several threads, and sums then depend on the machine.
    with single_thread(), threadpool_limits(1):
        first = errors(network)
        limits, unharmed = (1 + max(growth, NO_EFFECT)) * first, (1 + NO_EFFECT) * first
        while True:
            found = sorted(candidates(network, pixels["train"][0][known]), key=error)[:TRIES]
            for candidate in found:
                if (errors(candidate) <= unharmed).all() or (errors(trained_on(candidate)) <= limits).all():
                    network = candidate
                    break
            else:
                return network
