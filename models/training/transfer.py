"""From a pixel network to that of another unit of the same sensor, with few presses: what is tuned, and how.

    gains   a gain and an offset of ΔI for each channel, multiplied into the first layer: light and camera
    last    the last layer: how the features become a normal
    all     everything

The fewer numbers are tuned, the fewer presses they need. A network that has learned from the depth, too,
does so again after the normals: they alone would make its slopes flat (whole_frames/sums_of_slopes.py).
"""

from collections.abc import Sequence

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import scales
from fastac.models.training.normals import Fit, ScaledNetwork
from fastac.models.training.pruning.hidden_neurons import candidates, widths
from fastac.models.training.pruning.prune import gradient_error
from fastac.models.training.rounding_noise import with_rounding_noise
from fastac.models.training.whole_frames import sums_of_slopes
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.scenes.training_schema import Training

TUNES = ("gains", "last", "all")
"""What can be tuned, the fewest numbers first."""
STEPS = 800
"""Steps of a tuning, whatever number of presses there is."""
DEPTH_STEPS = 150
"""The same of that with the depth."""
RATE_SHARES = {"gains": 4.0, "last": 1.0, "all": 1.0}
"""Initial learning rates, as shares of the float network's in the scene."""


class InputGains(torch.nn.Module):
    """A float network behind a gain and an offset of each channel; the coordinates stay as they are."""

    def __init__(self, network: PixelNetwork):
        super().__init__()
        self.network = network
        channels = network.linear_layers[0].in_features - 2
        self.gain = torch.nn.Parameter(torch.ones(channels))
        self.offset = torch.nn.Parameter(torch.zeros(channels))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Scaled features (pixels, channels + 2) to normals (pixels, 3)."""
        channels = len(self.gain)
        return self.network(torch.cat([x[..., :channels] * self.gain + self.offset, x[..., channels:]], -1))

    def folded(self) -> PixelNetwork:
        """The network with gains and offsets in its first layer; the same function."""
        first, channels = self.network.linear_layers[0], len(self.gain)
        with torch.no_grad():
            first.bias += first.weight[:, :channels] @ self.offset
            first.weight[:, :channels] *= self.gain
        return self.network


def narrowed(
    network: PixelNetwork, x: np.ndarray, y: np.ndarray, hidden: Sequence[int], slope_limit: float
) -> PixelNetwork:
    """The network with at most `hidden` neurons a layer: those of least effect on the pixels are removed.

    For hardware whose integers lost neurons after they were quantised. x, y : features (pixels, inputs) and
    normals (pixels, 3)
    """
    while any(have > most for have, most in zip(widths(network), hidden, strict=True)):
        network = min(
            candidates(network, x, hidden), key=lambda fewer: gradient_error(fewer, x, y, slope_limit)
        )
    return network


def tune(
    network: PixelNetwork,
    x: np.ndarray,
    y: np.ndarray,
    settings: Training,
    what: str,
    *,
    pressed: WholeFrames | None = None,
    rounding_bits: int | None = None,
    progress: bool = False,
) -> tuple[PixelNetwork, list[dict]]:
    """Train on, in place, what TUNES calls `what`; returns the network and its learning curve.

    x, y : features (pixels, inputs) and unit normals (pixels, 3) of the new unit
    pressed : of the new unit, if the network shall learn from the depth, too; its split train counts
    rounding_bits : bits of the activations whose rounding layers that are tuned feel as noise; None: there
        is none
    """
    tuned = InputGains(network) if what == "gains" else with_rounding_noise(network, rounding_bits)
    for parameter in network.parameters():
        parameter.requires_grad = what == "all"
    if what == "last":
        for parameter in network.linear_layers[-1].parameters():
            parameter.requires_grad = True
    rate = settings.normals_learning_rate * RATE_SHARES[what]
    epochs = max(1, STEPS // -(-len(x) // settings.normals_batch_px))
    fit = Fit.of(settings, f"normals, {what}", epochs=epochs, rate=rate)
    history = fit(ScaledNetwork(tuned, scales(x.shape[1] - 2)), x, y, progress=progress)
    if pressed is not None and len(shown := pressed.index("train")):
        epochs = max(1, DEPTH_STEPS // -(-len(shown) // sums_of_slopes.BATCH_FRAMES))
        sums_of_slopes.fit(tuned, pressed, shown, epochs=epochs, rate=rate, progress=progress)
    for parameter in network.parameters():
        parameter.requires_grad = True
    return (tuned.folded() if what == "gains" else network), history


def at_other_places(x: np.ndarray, seed: int) -> np.ndarray:
    """Features (pixels, inputs), and the same ΔI at the places of other pixels, (2 · pixels, inputs).

    Few presses show few places; the ranges of the integers must hold for a contact anywhere.
    """
    moved = x.copy()
    moved[:, -2:] = x[np.random.default_rng(seed).permutation(len(x)), -2:]
    return np.concatenate([x, moved])
