"""Initial weights with which no hidden neuron of the pixel network begins dead.

PyTorch's own (uniform, biases around zero) see features that are far from unit spread: of 16 neurons of the
last hidden layer six are never active for any pixel, and stay so. Here each layer's weights are orthogonal
and scaled to the spread of its inputs, and a bias puts a neuron's threshold at a quantile of its own sum, so
that it is active for a known share of pixels. Sources: Saxe, McClelland, Ganguli, arXiv:1312.6120
(orthogonal weights); Krähenbühl et al., "Data-dependent Initializations of CNNs", arXiv:1511.06856.
"""

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import scales

SAMPLE_PX = 50_000
"""Pixels that the spreads and quantiles are found on, at most."""
CHANGED_SHARE = 0.05
"""Share of the pixels, those that differ most from the background, from which most of the sample is drawn:
most pixels are at rest and say little of contacts."""
CHANGED_SAMPLE = 0.8
"""Share of the sample that is drawn from them."""
QUANTILES = (0.2, 0.8)
"""Between which a neuron's threshold lies in its sums over the sample."""
LEAST_SPREAD = 1e-3
"""Of an input, as a float, where it hardly changes."""
LAST_GAIN = 0.3
"""Of the last layer: normals begin near that of a surface that faces the camera."""


def set_orthogonal(network: PixelNetwork, x: np.ndarray, seed: int) -> None:
    """Give the network orthogonal initial weights and spread thresholds; it is changed itself.

    x : integer features (pixels, inputs) to learn from; seed : of all draws
    """
    rng = np.random.default_rng(seed)
    generator = torch.Generator().manual_seed(seed)
    x = x[_sample(x, rng)]
    values = torch.from_numpy(x.astype(np.float32) * scales(x.shape[1] - 2).astype(np.float32))
    *hidden, last = network.linear_layers
    with torch.no_grad():
        for index, layer in enumerate(hidden):
            spread = values.std(dim=0).clamp_min(LEAST_SPREAD)
            torch.nn.init.orthogonal_(layer.weight, gain=2**0.5, generator=generator)
            # Features differ in their units, so each has its own; neurons of one layer share theirs.
            layer.weight /= spread.mean() if index else spread
            sums = values @ layer.weight.T
            for neuron, share in enumerate(rng.uniform(*QUANTILES, layer.out_features)):
                layer.bias[neuron] = -sums[:, neuron].quantile(share)
            values = torch.relu(sums + layer.bias)
        torch.nn.init.normal_(last.weight, generator=generator)
        last.weight *= LAST_GAIN / (last.in_features**0.5 * values.std(dim=0).mean().clamp_min(LEAST_SPREAD))


def _sample(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Indices of pixels of features x, most of them of those that differ most from the background."""
    change = np.abs(x[:, :-2]).max(axis=1)
    count = max(1, round(CHANGED_SHARE * len(x)))
    changed = np.argpartition(change, -count)[-count:]
    of_changed = rng.permutation(changed)[: round(CHANGED_SAMPLE * SAMPLE_PX)]
    return np.concatenate([of_changed, rng.permutation(len(x))[: SAMPLE_PX - len(of_changed)]])
