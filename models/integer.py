"""The integer reference: each stage's arithmetic, defined once.

Training, emulator, benches and hardware share these classes. Each is a frozen set of tables and widths
that checks itself and is called on int64 arrays; hardware equals it bit for bit.
Equations: Lu et al., "FasTac", section "FPGA-Based Edge Deployment".
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.fixed import NEAREST, check_rounding, exact_matmul, half_unit, round_shift, signed_width


def _fits(name: str, values, bits: int, *, signed: bool) -> None:
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    values = np.asarray(values)
    if values.size and (values.min() < low or values.max() > high):
        raise ValueError(f"{name} {values.min()} to {values.max()}: expected {low} to {high}")


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


@dataclass(frozen=True, eq=False)
class PoissonSource:
    """The right-hand side on the inner region: divergence of the slopes less `offset`.

    `central`: p[i,j+1] − p[i,j−1] + q[i+1,j] − q[i−1,j], one fractional bit more than the slopes.
    `backward`: p[i,j] − p[i,j−1] + q[i,j] − q[i−1,j], the paper's.
    `offset` is the boundary prior's term Σ D_prior of the neighbours on the boundary (absolute depth), or
    the source of the background's slopes (difference from the background).
    """

    divergence: str
    gradient_width: int
    offset: np.ndarray  # (H − 2, W − 2)
    offset_limit: int | None = None
    """The largest magnitude of any offset that the hardware may be loaded with; None: only this one."""

    def __post_init__(self):
        largest = int(np.abs(self.offset).max())
        if self.offset_limit is not None and largest > self.offset_limit:
            raise ValueError(f"offset {largest}: expected at most {self.offset_limit}")
        if self.divergence not in ("central", "backward"):
            raise ValueError(f"divergence {self.divergence!r}: expected central or backward")

    @property
    def terms(self) -> int:
        """How many slopes enter one value, each with weight ±1."""
        return 4

    @cached_property
    def bound(self) -> int:
        offset = int(np.abs(self.offset).max()) if self.offset_limit is None else self.offset_limit
        return self.terms * ((1 << (self.gradient_width - 1)) - 1) + offset

    @property
    def width(self) -> int:
        return signed_width(self.bound)

    def __call__(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (..., H, W, 2) to the source (..., H − 2, W − 2)."""
        return divergence_of(slopes, self.divergence) - self.offset


def divergence_of(slopes: np.ndarray, divergence: str) -> np.ndarray:
    """Slopes (..., H, W, 2) to their divergence (..., H − 2, W − 2); see PoissonSource for its units."""
    p, q = slopes[..., 0], slopes[..., 1]
    if divergence == "central":
        return (p[..., 1:-1, 2:] - p[..., 1:-1, :-2]) + (q[..., 2:, 1:-1] - q[..., :-2, 1:-1])
    return (p[..., 1:-1, 1:-1] - p[..., 1:-1, :-2]) + (q[..., 1:-1, 1:-1] - q[..., :-2, 1:-1])


@dataclass(frozen=True, eq=False)
class SineTransform:
    """One orthonormal DST-I pass along rows: `round_shift(matrix @ x, shift, rounding)`.

    matrix[k, n] = round(2**coefficient_fraction · sqrt(2/(N+1)) · sin(π(k+1)(n+1)/(N+1))).
    `bound` is the largest magnitude of the output that any input of the whole chain can reach.
    """

    matrix: np.ndarray  # (N, N)
    shift: int
    input_width: int
    output_width: int
    rounding: str = NEAREST

    def __post_init__(self):
        n = len(self.matrix)
        if self.matrix.shape != (n, n) or not np.array_equal(self.matrix, self.matrix.T):
            raise ValueError(f"matrix {self.matrix.shape}: expected square and symmetric")
        if self.shift < 1:
            raise ValueError(f"shift {self.shift}: expected at least 1")
        check_rounding(self.rounding)

    @property
    def size(self) -> int:
        return len(self.matrix)

    @property
    def half_unit(self) -> int:
        """What rounding adds to a sum before the shift; 0 with a floor."""
        return int(half_unit(self.shift, self.rounding))

    @property
    def coefficient_width(self) -> int:
        return signed_width(int(np.abs(self.matrix).max()))

    @cached_property
    def accumulator_bound(self) -> int:
        """max over rows of Σ|coefficient|·|x|max, plus the half unit that rounding adds."""
        return (int(np.abs(self.matrix).sum(axis=1).max()) << (self.input_width - 1)) + self.half_unit

    @property
    def accumulator_width(self) -> int:
        return signed_width(self.accumulator_bound)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Rows (..., N) to their transforms (..., N)."""
        sums = exact_matmul(rows, self.matrix, self.accumulator_bound)
        return round_shift(sums, self.shift, self.rounding)


@dataclass(frozen=True, eq=False)
class EigenvalueDivision:
    """`round_shift(−x · mantissa, shift, rounding)`, element by element.

    The eigenvalues 2cos(πm/(N+1)) + 2cos(πn/(N+1)) − 4 are negative; mantissa · 2**−shift is the reciprocal
    of their magnitude times the change of units, the mantissa normalised to 17 bits.
    """

    mantissa: np.ndarray  # (N, N) unsigned, 2**16 … 2**17 − 1
    shift: np.ndarray  # (N, N)
    input_width: int
    output_width: int
    rounding: str = NEAREST

    def __post_init__(self):
        check_rounding(self.rounding)
        _fits("mantissa", self.mantissa, 17, signed=False)
        _fits("shift", self.shift - 1, 6, signed=False)
        for table in (self.mantissa, self.shift):
            if not np.array_equal(table, table.T):
                raise ValueError("table: expected symmetric")

    @property
    def size(self) -> int:
        return len(self.mantissa)

    @property
    def half_bit(self) -> int:
        """What rounding adds once all bits of a shift but one are dropped; 0 with a floor."""
        return int(half_unit(1, self.rounding))

    @property
    def product_width(self) -> int:
        return self.input_width + 17

    def __call__(self, coefficients: np.ndarray) -> np.ndarray:
        """Coefficients (..., N, N), of either orientation, to the solution's coefficients."""
        return round_shift(-coefficients * self.mantissa, self.shift, self.rounding)


@dataclass(frozen=True, eq=False)
class Depth:
    """What leaves the solver: the depth, and the displacement from rest.

    `absolute`: depth = z, displacement = rest − z, `rest` being what the pipeline finds at rest.
    `difference`: depth = rest + z, displacement = −z, `rest` being the known skin.
    """

    mode: str
    input_width: int
    rest: np.ndarray  # (N, N)
    loadable: bool = False
    """Whether the hardware may be loaded with another `rest`, any solution of the solver."""

    def __post_init__(self):
        if self.mode not in ("absolute", "difference"):
            raise ValueError(f"mode {self.mode!r}: expected absolute or difference")

    @cached_property
    def width(self) -> int:
        """Bits of depth and of displacement alike."""
        if self.loadable:
            return self.input_width + 1
        return signed_width((1 << (self.input_width - 1)) + int(np.abs(self.rest).max()))

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solutions (..., N, N) to depth and displacement of the same shape."""
        if self.mode == "absolute":
            return z, self.rest - z
        return self.rest + z, -z


@dataclass(frozen=True)
class DisplacementQuantiser:
    """`q = clip(round_shift(max(d, 0), shift), 0, 2**bits − 1)`, the paper's Q_z.

    Without the clamp q is signed: `clip(round_shift(d, shift), −t, t)`, t = 2**(bits − 1) − 1.
    """

    input_width: int
    shift: int
    bits: int
    clamp: bool = True

    @property
    def top(self) -> int:
        """The largest word."""
        return (1 << (self.bits if self.clamp else self.bits - 1)) - 1

    def __call__(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements of any shape to words, and which of them saturated."""
        scaled = round_shift(np.maximum(d, 0) if self.clamp else d, self.shift)
        return np.clip(scaled, -self.top, self.top), np.abs(scaled) > self.top


@dataclass(frozen=True, eq=False)
class PatchForce:
    """Position-dependent K×K kernels on the displacement, summed over the frame: A = Σ_p Σ_m k_{p,m} v_{p,m}.

    Outside the inner region the displacement is zero.
    """

    kernel: np.ndarray  # (axes, N, N, K, K)
    kernel_bits: int
    displacement_bits: int
    signed: bool = False
    """Whether displacements are, as without the clamp."""

    def __post_init__(self):
        _fits("kernel", self.kernel, self.kernel_bits, signed=True)

    @property
    def displacement_limit(self) -> int:
        """The largest magnitude of a displacement."""
        return (1 << (self.displacement_bits - 1 if self.signed else self.displacement_bits)) - 1

    @property
    def size(self) -> int:
        """K, the side of the window."""
        return self.kernel.shape[-1]

    @cached_property
    def pixel_bound(self) -> int:
        return int(np.abs(self.kernel).sum(axis=(-2, -1)).max()) * self.displacement_limit

    @cached_property
    def bound(self) -> int:
        """Σ|k|·displacement_limit over the whole frame, the worst axis."""
        return int(np.abs(self.kernel).sum(axis=(1, 2, 3, 4)).max()) * self.displacement_limit

    @property
    def pixel_width(self) -> int:
        return signed_width(self.pixel_bound)

    @property
    def width(self) -> int:
        return signed_width(self.bound)

    def force_map(self, q: np.ndarray) -> np.ndarray:
        """Displacement words (..., N, N) to pixel-wise responses (..., axes, N, N)."""
        half = self.size // 2
        padding = [(0, 0)] * (q.ndim - 2) + [(half, half), (half, half)]
        windows = np.lib.stride_tricks.sliding_window_view(
            np.pad(q, padding), (self.size, self.size), axis=(-2, -1)
        )
        return np.einsum("...ijkl,aijkl->...aij", windows, self.kernel)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Displacement words (..., N, N) to raw accumulators (..., axes)."""
        return self.force_map(q).sum(axis=(-2, -1))

    def collapsed(self) -> "WeightedSum":
        """The same resultant from one weight a pixel: Σ_p Σ_m k_{p,m} v_{p+m} = Σ_p (Σ_m k_{p−m,m}) v_p."""
        axes, n, _, k, _ = self.kernel.shape
        half = k // 2
        weight = np.zeros((axes, n + 2 * half, n + 2 * half), np.int64)
        for i in range(k):
            for j in range(k):
                weight[:, i : i + n, j : j + n] += self.kernel[..., i, j]
        inner = slice(half, half + n)
        return WeightedSum(
            weight[:, inner, inner, None], np.zeros(axes, np.int64), self.displacement_bits, self.signed
        )


@dataclass(frozen=True, eq=False)
class WeightedSum:
    """One sum over the whole frame for each axis: A = constant + Σ_p Σ_t weight_{p,t} · x_{p,t}.

    With the displacement (one term a pixel) it is the collapsed kernels' force, with the slopes p and q (two
    terms) the adjoint's.
    """

    weight: np.ndarray  # (axes, rows, columns, terms)
    constant: np.ndarray  # (axes,)
    input_width: int
    input_signed: bool
    loadable: bool = False
    """Whether the hardware may be loaded with other constants, any sum of other inputs."""

    def __post_init__(self):
        if self.weight.ndim != 4 or self.constant.shape != self.weight.shape[:1]:
            raise ValueError(
                f"weight {self.weight.shape}, constant {self.constant.shape}:"
                " expected (axes, rows, columns, terms) and (axes,)"
            )

    @property
    def input_limit(self) -> int:
        """The largest magnitude of an input, which is never the lowest word of a signed format."""
        return (1 << (self.input_width - 1 if self.input_signed else self.input_width)) - 1

    @cached_property
    def weight_width(self) -> int:
        return signed_width(int(np.abs(self.weight).max()))

    @cached_property
    def bound(self) -> int:
        """|constant| + Σ|weight|·input_limit, the worst axis."""
        reached = np.abs(self.weight).sum(axis=(1, 2, 3)) * self.input_limit
        return int(((reached if self.loadable else np.abs(self.constant)) + reached).max())

    @property
    def width(self) -> int:
        return signed_width(self.bound)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Inputs (..., rows, columns, terms) to raw accumulators (..., axes)."""
        flat = self.weight.reshape(len(self.weight), -1)
        sums = exact_matmul(x.reshape(*x.shape[:-3], -1), flat.T, self.bound)
        return sums + self.constant
