"""Initial weights of the pixel network with which no hidden neuron is dead.

Most pixels are at rest and look much alike. With weights and biases that are drawn by chance alone, a neuron
may then give 0 for all of them, the likelier the deeper its layer; it has no derivative, and training leaves
most of such neurons as they are. What the network can learn then hangs on chance. Sources: of orthogonal
weights, Saxe, McClelland, Ganguli, "Exact solutions to the nonlinear dynamics of learning in deep linear
neural networks", ICLR 2014; of initial values that follow from data, Krähenbühl, Doersch, Donahue, Darrell,
"Data-dependent initializations of convolutional neural networks", ICLR 2016.
"""

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import scales

PIXELS = 1 << 16
"""From which thresholds are drawn, at most."""


@single_thread()
@torch.no_grad()
def set_active(network: PixelNetwork, x: np.ndarray, seed: int) -> None:
    """Give the hidden layers orthogonal weights and each neuron the bias with which its activation begins at
    a pixel that is drawn by chance.

    x : integer features (pixels, inputs)
    The same for the same pixels and seed.
    """
    generator = torch.Generator().manual_seed(seed)
    drawn = torch.randperm(len(x), generator=generator)[:PIXELS].numpy()
    seen = torch.from_numpy((x[drawn] * scales(x.shape[1] - 2)).astype(np.float32))
    for layer in network.linear_layers[:-1]:
        torch.nn.init.orthogonal_(layer.weight, generator=generator)
        sums = seen @ layer.weight.T
        thresholds = torch.randint(len(sums), (1, sums.shape[1]), generator=generator)
        layer.bias.copy_(-sums.gather(0, thresholds)[0])
        seen = torch.relu(sums + layer.bias)
