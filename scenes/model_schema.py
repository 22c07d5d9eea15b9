"""The scene's tables of the model: network, numbers, Poisson solver, force and slip."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from fastac.scenes.strict import Positive, Strict

FEWEST_NEURONS, MOST_NEURONS = 4, 64
"""Of a hidden layer, also after pruning."""
Neurons = Annotated[int, Field(ge=FEWEST_NEURONS, le=MOST_NEURONS)]


def _widths(value: object) -> object:
    """The value itself; raises ValueError, for both forms at once, unless it is a network's width."""
    numbers = value if isinstance(value, list | tuple) else [value] * 3
    if len(numbers) != 3 or not all(
        type(number) is int and FEWEST_NEURONS <= number <= MOST_NEURONS for number in numbers
    ):
        raise ValueError(
            f"expected a number from {FEWEST_NEURONS} to {MOST_NEURONS}, or a list of three, one for each"
            " hidden layer"
        )
    return value


Width = Annotated[Neurons | tuple[Neurons, Neurons, Neurons], BeforeValidator(_widths)]


def _by_layer(width: int | tuple[int, int, int]) -> tuple[int, int, int]:
    return (width,) * 3 if isinstance(width, int) else width


def _depths(value: object) -> object:
    """The value itself; raises ValueError, for both forms at once, unless it is a depth in mm or a list of
    ascending ones."""
    depths = value if isinstance(value, list | tuple) else [value]
    numbers = all(isinstance(depth, int | float) and not isinstance(depth, bool) for depth in depths)
    if not (depths and numbers and all(a < b for a, b in pairwise([0, *depths]))):
        raise ValueError("expected a number of mm greater than 0, or an ascending list of such numbers")
    return value


Depths = Annotated[Positive | tuple[Positive, ...], BeforeValidator(_depths)]


class Network(Strict):
    """The pixel network: three hidden layers, then the normal."""

    width: Width = 16
    """Neurons of each hidden layer: of all alike, or a list with one number a layer. 16 are the paper's."""
    train_width: Width | None = None
    """Neurons that are trained, at least `width` in each layer: those of least effect are then removed until
    `width` remain, whatever the training's outcome, so that the hardware is known before it. Not given: as
    many as `width`."""
    prune: Annotated[float, Field(ge=0, lt=1)] | None = None
    """Largest relative growth of the slopes' error, on the validation frames, for which hidden neurons are
    removed after training, and digits of baked weights. 0: only what makes no error larger. Not given: the
    network keeps its width. With `train_width`: of the digits alone, for neurons follow from the widths."""
    smoothing_px: Literal[0, 2, 4, 8] = Field(0, exclude_if=lambda value: not value)
    """Side of the square window over which the differences from the background are averaged before the
    network sees them; 0: none. Takes noise away, and with it what is finer than the window. In hardware it
    costs additions, memory for so many rows, and the time of half as many until a result."""
    bridge_dots: bool = False
    """Whether pixels under the marker dots take the slopes of the skin beside them. The network is then
    trained on skin alone."""

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each hidden layer as asked; pruning without `train_width` may keep fewer."""
        return _by_layer(self.width)

    @property
    def trained(self) -> tuple[int, ...]:
        """Neurons of each hidden layer that training begins with."""
        return self.hidden if self.train_width is None else _by_layer(self.train_width)


class Numbers(Strict):
    """Word lengths. Widths that are not listed follow from computed bounds."""

    weight_bits: Annotated[int, Field(ge=3, le=8)] = 8
    last_weight_bits: Annotated[int, Field(ge=3, le=16)] = 12
    """Of the layer whose outputs are kept wide."""
    activation_bits: Annotated[int, Field(ge=3, le=10)] = 7
    """Of the hidden layers, unsigned. 7 are the paper's; up to 10, a product with an 8-bit weight still has
    the 18 bits that let a DSP48E2 hold two. In a DSP48E1, on Zynq-7000, two fit up to 9 bits, or 10 with
    weights of 7 bits."""
    gradient_fraction_bits: Annotated[int, Field(ge=6, le=16)] = 14
    slope_limit: Literal[1, 2, 4, 8] = 4
    coefficient_fraction_bits: Annotated[int, Field(ge=8, le=17)] = 17
    data_bits: Annotated[int, Field(ge=12, le=26)] = 26
    rounding: Literal["nearest", "floor"] = "nearest"
    """How the Poisson solver's transforms, division and recurrences drop bits. floor cuts them off: no half
    unit is added before. That saves an addend a value and no clock, and the errors, all of one sign, add up.
    Mean depth error, nearest → floor, of a two-dimensional transform alone, N = 126, by fractional bits of
    gradients/coefficients/data: 16/16/16: 3.6 → 8.5 µm in absolute mode, 0.019 → 0.93 µm in difference
    mode; 12/16/12: 1.5 → 87 µm and 0.35 → 15 µm. Slopes and the quantised displacement are always rounded
    to the nearest, and the network's half units are in its biases."""
    displacement_bits: Annotated[int, Field(ge=4, le=16)] = 16
    kernel_bits: Annotated[int, Field(ge=3, le=18)] = 8
    slope_weight_bits: Annotated[int, Field(ge=6, le=18)] = 16
    """Of the adjoint's weights of the slopes."""
    dot_weight_bits: Annotated[int, Field(ge=6, le=18)] = 16
    """Of the weights of the marker dots' shifts."""

    @property
    def slope_bits(self) -> int:
        """Of a slope with its sign: what `slope_limit` needs before the point, and the fraction behind it."""
        return self.gradient_fraction_bits + self.slope_limit.bit_length()


class Poisson(Strict):
    mode: Literal["absolute", "difference"] = "difference"
    """What is solved for: the depth itself, as in the paper, or its difference from rest: the same equation,
    but what the network finds at rest cancels exactly."""
    divergence: Literal["central", "backward"] = "central"
    solver: str = "dst2d"
    """An entry of scenes/solvers.py. dst2d: sine transforms of rows and columns, the paper's. tridiagonal: of
    the rows alone; depth leaves last row first. adjoint: no depth at all; the force is a weighted sum of the
    slopes."""


class Force(Strict):
    source: Literal["displacement", "slopes"] | None = None
    """What the force is of. displacement: of the solver's depth, less that at rest. slopes: a weighted sum of
    the slopes, as with the adjoint, which is there when the last pixel is, beside a solver for the depth. Not
    given: displacement where poisson.solver finds depth, slopes where it does not."""
    kernel: Literal["patch", "collapsed"] = "patch"
    """patch: a K×K kernel at every pixel, which a force map needs. collapsed: the same resultant, to the
    bit, from one weight a pixel."""
    kernel_size: Literal[1, 3, 5, 7] = 5
    clamp: bool = True
    """Whether displacement away from the camera counts as zero, as in the paper; with `band_mm` it never
    does."""
    fit: str = "displacement"
    """How the model is found, an entry of scenes/force_fits.py. displacement: HyperForce, trained on the
    displacement; the adjoint's weights of the slopes follow from its kernels. weights: one weight a pixel of
    the displacement, smooth over the image, by ridge regression. polynomials: the same, but each weight is a
    polynomial of the pixel's place on the skin at rest, which few presses determine better. slopes: smooth
    weights of the slopes, which are then what the force is of."""
    band_mm: Positive | None = None
    """What is displaced beyond ±band_mm, in the contact and in the bulge around it, has weights of its own:
    the force is then not linear in the displacement. With fit 'weights' or 'polynomials'."""
    deep_mm: Depths | None = None
    """What is pressed deeper than this has one more weight, beside those of `band_mm`; of several depths, in
    ascending order, each has one. A model that knows it finds the force of objects of other shapes better."""
    block_px: Literal[1, 2, 4, 8] = Field(1, exclude_if=lambda value: value == 1)
    """Side of the squares whose pixels share their weights, so that the memory of the weights is that much
    smaller each way. With a force of slopes, or with fit 'weights' or 'polynomials', whose weights change
    slowly from pixel to pixel."""
    dots: bool = False
    """Whether the shifts of the marker dots are a part of the force, beside displacement or slopes: without
    them little shows how the skin is dragged."""
    hidden: Annotated[int, Field(ge=1, le=256)] = 32
    max_displacement_mm: Positive = 2.0
    coverage: Annotated[float, Field(gt=0, lt=1)] | None = Field(None, exclude_if=lambda value: value is None)
    """Share of presses for which the true force shall be within an interval around what is found, on each
    axis, as 0.9. How wide the interval is in each frame follows from measures of the frame and from the
    errors of presses in the validation split. Not given: no intervals."""

    @property
    def bends_mm(self) -> tuple[float, ...]:
        """Where the force bends in the displacement: nowhere, or at ±band_mm and at each of deep_mm."""
        return (*(() if self.band_mm is None else (self.band_mm,)), *self.depths_mm)

    @property
    def depths_mm(self) -> tuple[float, ...]:
        """Each of deep_mm, ascending."""
        if self.deep_mm is None:
            return ()
        return self.deep_mm if isinstance(self.deep_mm, tuple) else (self.deep_mm,)

    @property
    def signed(self) -> bool:
        """Whether displacement away from the camera counts."""
        return not self.clamp or self.band_mm is not None


class Slip(Strict):
    """Of the output slip: the spread of the touching dots' shifts about the rigid motion that fits them."""

    contact_mm: Positive = 0.06
    """Displacement beyond which the skin at a dot counts as in contact. Around a contact the skin moves, too,
    but less."""
    limit_px: Positive = 0.3
    """Root mean square spread above which a frame is flagged as slipping. In hardware it is the initial value
    of a register."""
