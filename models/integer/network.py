"""The pixel network in integers: layers, requantisation of their sums, and slopes from normals."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.words import _fits, exact_matmul, signed_width


@dataclass(frozen=True, eq=False)
class Requantisation:
    """`clip(floor(multiplier * max(0, a) / 2**shift), 0, 2**bits - 1)`, the paper's q^(l+1).

    One multiplier per neuron, of at most 17 bits: it shares a DSP48E2 through the signed 18-bit port.
    """

    multiplier: np.ndarray  # (neurons,)
    shift: int
    bits: int = 7

    def __post_init__(self):
        if self.multiplier.min() < 1:
            raise ValueError(f"multiplier {self.multiplier.min()}: expected at least 1")
        _fits("multiplier", self.multiplier, 17, signed=False)
        if not 0 <= self.shift < 48:
            raise ValueError(f"shift {self.shift}: expected 0 to 47")

    def __call__(self, a: np.ndarray) -> np.ndarray:
        """Accumulators (..., neurons) to activations (..., neurons)."""
        return np.minimum((np.maximum(a, 0) * self.multiplier) >> self.shift, (1 << self.bits) - 1)


@dataclass(frozen=True, eq=False)
class Layer:
    """A fully connected layer: `weight @ x + bias`, then ReLU and requantisation unless it is the last."""

    weight: np.ndarray  # (neurons, inputs)
    bias: np.ndarray  # (neurons,)
    input_limit: np.ndarray  # (inputs,), the largest magnitude of each input
    weight_bits: int = 8
    requantisation: Requantisation | None = None
    loadable: bool = False
    """Whether the hardware takes other weights and biases later: its words must hold any of them."""

    def __post_init__(self):
        _fits("weight", self.weight, self.weight_bits, signed=True)
        if self.loadable and np.abs(self.weight).max() > self.weight_limit:
            raise ValueError(f"weight {self.weight.min()}: expected at least {-self.weight_limit}")
        if self.loadable and np.abs(self.bias).max() > self.bias_limit:
            raise ValueError(f"bias {np.abs(self.bias).max()}: expected at most {self.bias_limit}")

    @property
    def weight_limit(self) -> int:
        """The largest magnitude of a loadable weight."""
        return (1 << (self.weight_bits - 1)) - 1

    @property
    def bias_limit(self) -> int:
        """The largest magnitude of a loadable bias: what the weights and inputs reach together."""
        return self.weight_limit * int(self.input_limit.sum())

    @cached_property
    def accumulator_bound(self) -> int:
        """max over neurons of Σ|w|·|x|max + |b|; of any weights and biases where they are loadable."""
        if self.loadable:
            return 2 * self.bias_limit
        return int((np.abs(self.weight) @ self.input_limit + np.abs(self.bias)).max())

    @property
    def accumulator_width(self) -> int:
        return signed_width(self.accumulator_bound)

    def accumulate(self, x: np.ndarray) -> np.ndarray:
        """Inputs (..., inputs) to biased accumulators (..., neurons)."""
        return exact_matmul(x, self.weight.T, self.accumulator_bound) + self.bias

    def __call__(self, x: np.ndarray) -> np.ndarray:
        a = self.accumulate(x)
        return a if self.requantisation is None else self.requantisation(a)


@dataclass(frozen=True)
class GradientRatio:
    """Slopes p = −n_x/n_z, q = −n_y/n_z in words of `width` bits, `fraction` of them behind the point.

    Magnitudes are rounded to the nearest, halves up, and saturate at 2**(width−1) − 1. Where n_z <= 0 the
    surface is no graph over the image: the slope saturates in the direction of n, and is 0 where that
    component is 0.
    """

    normal_width: int
    width: int
    fraction: int

    @property
    def limit(self) -> int:
        return (1 << (self.width - 1)) - 1

    def __call__(self, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normals (..., 3) of any length to slopes (..., 2) and saturated (..., 2) bool."""
        n_xy, n_z = normal[..., :2], normal[..., 2:]
        divisor = np.where(n_z > 0, n_z, 1)
        magnitude = ((np.abs(n_xy) << (self.fraction + 1)) + divisor) // (2 * divisor)
        magnitude = np.where(n_z > 0, magnitude, np.where(n_xy == 0, 0, self.limit))
        saturated = (magnitude > self.limit) | (n_z <= 0)
        return -np.sign(n_xy) * np.minimum(magnitude, self.limit), saturated
