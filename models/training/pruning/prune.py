"""Pruning of the float pixel network: hidden neurons are removed in the order of their least effect.

After each neuron the network is trained on. It ends where the error has grown too much, and the network
before that neuron is kept; or at a width that was asked for, whatever the error is then.
"""

from collections.abc import Callable, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.models.floating.network import PixelNetwork, predict, slopes_of
from fastac.models.floating.threads import single_thread
from fastac.models.integer.features import scales
from fastac.models.training.normals import Fit, ScaledNetwork, _tensors
from fastac.models.training.pruning.hidden_neurons import candidates, widths
from fastac.models.training.rounding_noise import with_rounding_noise
from fastac.scenes.model_schema import FEWEST_NEURONS
from fastac.scenes.training_schema import Training

JUDGED_PX = 1 << 14
"""Pixels on which the neurons' effects are compared."""
COMBINED_PX = 1 << 16
"""Pixels from which a neuron's linear combination is found."""
TRIES = 2
"""Neurons that are tried in turn, those of least effect, before nothing more is removed."""
TUNING_SHARE = 0.2
"""Epochs after each neuron, as a share of the float network's, where the error decides."""
NO_EFFECT = 1e-4
"""Relative growth of the error up to which a neuron counts as without effect: nothing is trained after it."""
WIDTH_SHARE = 0.1
"""Epochs after each neuron, as a share of the float network's, on the way to a width."""
LAST_SHARE, LAST_ROUNDS = 0.4, 3
"""The same once the width is reached, so many times."""


def gradient_error(network: PixelNetwork, x: np.ndarray, y: np.ndarray, slope_limit: float) -> float:
    """Mean absolute error of both slopes together, features (pixels, inputs) against normals (pixels, 3)."""
    truth = slopes_of(y.astype(np.float64), slope_limit)
    return float(np.abs(slopes_of(predict(network, x), slope_limit) - truth).sum(axis=1).mean())


class Pruning:
    """What both ways of pruning do with a network: rank what is left without one neuron, and train on.

    pixels : features and normals by split name, from `labelled_splits`; judged is the validation split or,
        where there is none, the train split
    slope_limit : magnitude at which slopes are clipped
    rounding_bits : bits of the activations whose rounding is felt as noise in training; None: there is none
    """

    def __init__(
        self,
        pixels: dict[str, tuple[np.ndarray, np.ndarray]],
        settings: Training,
        slope_limit: float,
        *,
        rounding_bits: int | None = None,
        progress: bool,
    ):
        self.pixels, self.settings, self.slope_limit, self.progress = pixels, settings, slope_limit, progress
        self.rounding_bits = rounding_bits
        self.judged = pixels.get("validation", pixels["train"])
        rng = np.random.default_rng(settings.seed)
        few = rng.permutation(len(self.judged[0]))[:JUDGED_PX]
        known = rng.permutation(len(pixels["train"][0]))[:COMBINED_PX]
        self.few, self.known = tuple(values[few] for values in self.judged), pixels["train"][0][known]

    def error(self, network: PixelNetwork) -> float:
        """The mean slope error on all judged pixels."""
        return gradient_error(network, *self.judged, self.slope_limit)

    def ranked(self, network: PixelNetwork, fewest: tuple[int, ...]) -> list[PixelNetwork]:
        """The network without one neuron of a layer that has more than its `fewest`, least effect first."""
        return sorted(
            candidates(network, self.known, fewest),
            key=lambda candidate: gradient_error(candidate, *self.few, self.slope_limit),
        )

    def trained_on(self, network: PixelNetwork, share: float) -> PixelNetwork:
        """The network itself, trained on for a share of the float network's epochs, one at least."""
        fit = Fit.of(
            self.settings,
            f"normals, {'-'.join(map(str, widths(network)))}",
            epochs=max(1, round(share * self.settings.normals_epochs)),
        )
        felt = with_rounding_noise(network, self.rounding_bits)
        model = ScaledNetwork(felt, scales(network.linear_layers[0].in_features - 2))
        fit(model, *self.pixels["train"], validation=_tensors(self.pixels), progress=self.progress)
        return network


def prune_neurons(
    network: PixelNetwork,
    pixels: dict[str, tuple[np.ndarray, np.ndarray]],
    settings: Training,
    *,
    growth: float,
    slope_limit: float,
    further_errors: Sequence[Callable[[PixelNetwork], float]] = (),
    rounding_bits: int | None = None,
    progress: bool = False,
) -> PixelNetwork:
    """The network with as few hidden neurons as the error allows; `network` itself is not changed.

    pixels, slope_limit, rounding_bits : see `Pruning`
    growth : largest relative growth of the mean slope error of `network`
    further_errors : of a network, errors that must not grow by more either

    The same for the same pixels and `settings.seed`.
    """
    pruning = Pruning(pixels, settings, slope_limit, rounding_bits=rounding_bits, progress=progress)
    fewest = (FEWEST_NEURONS,) * len(widths(network))

    def errors(candidate: PixelNetwork) -> np.ndarray:
        return np.array([pruning.error(candidate), *(error(candidate) for error in further_errors)])

    # Small products are slower on several threads, and sums then depend on the machine.
    with single_thread(), threadpool_limits(1):
        first = errors(network)
        limits, unharmed = (1 + max(growth, NO_EFFECT)) * first, (1 + NO_EFFECT) * first
        while True:
            for candidate in pruning.ranked(network, fewest)[:TRIES]:
                if (errors(candidate) <= unharmed).all():
                    network = candidate
                    break
                if (errors(pruning.trained_on(candidate, TUNING_SHARE)) <= limits).all():
                    network = candidate
                    break
            else:
                return network


def prune_to_width(
    network: PixelNetwork,
    pixels: dict[str, tuple[np.ndarray, np.ndarray]],
    settings: Training,
    *,
    width: tuple[int, ...],
    slope_limit: float,
    rounding_bits: int | None = None,
    progress: bool = False,
) -> PixelNetwork:
    """The network with `width` neurons in each hidden layer; `network` itself is not changed.

    pixels, slope_limit, rounding_bits : see `Pruning`
    width : at most what `network` has, layer by layer

    The same for the same pixels and `settings.seed`.
    """
    pruning = Pruning(pixels, settings, slope_limit, rounding_bits=rounding_bits, progress=progress)
    with single_thread(), threadpool_limits(1):
        pruned = network
        while widths(pruned) != width:
            pruned = pruning.trained_on(pruning.ranked(pruned, width)[0], WIDTH_SHARE)
        for _ in range(0 if pruned is network else LAST_ROUNDS):
            pruned = pruning.trained_on(pruned, LAST_SHARE)
        return pruned
