"""The scene's tables of the model: network, numbers, Poisson solver, force, and how they are trained."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from fastac.scenes.strict import Count, Positive, Strict

FEWEST_NEURONS, MOST_NEURONS = 4, 64
"""Of a hidden layer, also after pruning."""
LIGHT_NOISE, CURL_WEIGHT, PRESS_REACH = 0.01, 1.0, 0.05
"""Of a training from forces alone whose scene does not say."""
PATIENCE_SIZES = 3
"""Of a training from forces alone, which fits smooth weights five times: the largest sizes take most of the
time."""
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


class Training(Strict):
    labels: Literal["geometry", "force"] = "geometry"
    """What the pixel network learns from. geometry: normals. force: the force alone; network and weights of
    the slopes are then learned together, and the slopes are at best true up to a factor."""
    seed: Annotated[int, Field(ge=0)] = 1
    patience_epochs: Count | None = None
    """Epochs in a row that do not lower the validation error, after which the training of a pixel network
    stops; the numbers of epochs are then upper limits. Training from forces alone, which anneals its rates
    over all epochs otherwise, then keeps them and takes the mean of the network's weights over an epoch: that
    is for a recording whose epochs are so long that nobody can wait for all. Not given, or where no frame is
    in the validation split: all epochs."""
    normals_epochs: Count = 30
    normals_batch_px: Count = 8192
    normals_share: Annotated[float, Field(gt=0, le=1)] = Field(1.0, exclude_if=lambda value: value == 1)
    """Share of the labelled pixels that the pixel network learns from, chosen by chance, with labels
    'geometry'. A force with many weights gains from more presses long after the network has stopped gaining;
    with a share of the pixels they do not lengthen its training. Recordings are thinned too, but for
    `fastac adapt`."""
    teachers: Annotated[int, Field(ge=0, le=32)] = 0
    """Wide networks whose mean teaches the small one; 0: it learns from the labels itself."""
    teacher_width: Count = 32
    teacher_epochs: Count = 100
    normals_learning_rate: Positive = 2e-3
    input_noise: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Standard deviation of the noise added to ΔI in training, as a fraction of its spread."""
    position_noise: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Standard deviation of the noise added to the pixel's place in training, as a fraction of half the
    image: where presses are few, it keeps the network from learning each place by heart."""
    huber_delta: Annotated[float, Field(ge=0, le=1)] = Field(0.0, exclude_if=lambda value: not value)
    """Below about this error of a component of the unit normal, squares of errors are minimised instead of
    absolute errors, with labels 'geometry' (pseudo-Huber loss); 0: absolute errors, as in the paper. Most
    pixels are at rest, and where noise leaves two slopes possible the smallest absolute error is that of the
    likelier one: gentle slopes come out too small, and with them depth and force, which are sums over many
    pixels. The smallest squared error is that of their mean."""
    depth_weight: Annotated[float, Field(ge=0)] = Field(0.0, exclude_if=lambda value: not value)
    """Weight of the depth's mean squared error, in pixels squared, beside the normals' loss, while the
    network is trained on at the end (models/training/whole_frames/), with labels 'geometry'; 0: it is
    not. Slopes that noise hides are too flat where normals alone count, and the depth lacks what all of them
    lack. The larger the weight, the better the depth, and the noisier single normals. Needs frames whose
    depth is known at every pixel, or contact circles of balls, inside which its shape is known."""
    force_weight: Annotated[float, Field(ge=0)] = Field(0.0, exclude_if=lambda value: not value)
    """Weight of the force's error, in N, summed over the axes, beside the normals' loss in that training: the
    network bends its slopes until a weighted sum of them, or of the displacement that they give, is the force
    of presses that the weights were not fitted to. With labels 'geometry' and fit 'slopes' or 'displacement',
    without dots. The larger the weight, the better the force, and the less the network's normals are those of
    the skin."""
    depth_epochs: Count = Field(8, exclude_if=lambda value: value == 8)
    """Of the training with the depth or the force, on whole frames."""
    depth_learning_rate: Positive | None = Field(None, exclude_if=lambda value: value is None)
    """Of that training, at its highest; not given: `normals_learning_rate`. A network goes far from its
    normals to slopes whose sum is the force, and takes a larger one well."""
    force_steps: Annotated[int, Field(ge=0)] = Field(0, exclude_if=lambda value: not value)
    """Steps of least squares on the error of the force alone that are tried at the very end, on whole frames
    (models/training/whole_frames/force_least_squares.py), with labels 'geometry' and fit 'slopes', where
    forces are the only outputs: the network's slopes are then any whose weighted sum is the force. Needs more
    forces of training presses than the network has parameters and the force weights, and ten times as many to
    be of use."""
    rounding_noise: bool = Field(False, exclude_if=lambda value: not value)
    """Whether the network feels the rounding of its hidden activations to `numbers.activation_bits` as noise
    while it is trained, with labels 'geometry'. Worth it at 7 bits and fewer."""
    weight_rounding_noise: bool = Field(False, exclude_if=lambda value: not value)
    """Whether the network feels the rounding of its hidden weights to `numbers.weight_bits` as noise while it
    is trained on whole frames: sums over many pixels lose less by it, the depth above all."""
    light_noise: Annotated[float, Field(ge=0, lt=1)] | None = None
    """Standard deviation of the gain by which each channel of a frame is made brighter or darker in training,
    as a fraction, with labels 'force': what lamps and exposure differ by from one recording to the next. Not
    given: 0.01."""
    curl_weight: Annotated[float, Field(ge=0)] | None = Field(None, exclude_if=lambda value: value is None)
    """Weight of the slopes' curl in training, beside the force's relative error, with labels 'force'. Slopes
    of a surface have none; 0 lets the two outputs be any that explain the force. Not given: 1."""
    press_reach: Annotated[float, Field(ge=0, le=0.25)] | None = Field(
        None, exclude_if=lambda value: value is None
    )
    """How far presses are moved, at most, in copies that the force's weights are fitted to as well, with
    labels 'force': a share of the image's smaller side. On a gel that is alike everywhere a press has the
    same force a little farther on, and few presses do not tell. Neither dots nor symmetric weights
    (`press_symmetry`) go with it. Not given: 0.05."""
    press_symmetry: bool | None = Field(None, exclude_if=lambda value: value is None)
    """Whether the force's weights may be such that a mirrored press has the mirrored force and, on a square
    image, a press turned by a quarter the same F_z, as on a gel that is alike in all directions, with labels
    'force'. They are where that lowers the error on recordings left out of the last fit or, where there is
    one recording or none is named, on the validation frames. Not with dots. Not given: true."""
    flat_fraction: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of background pixels in each epoch, where only contacts are labelled."""
    circle_margin: Annotated[float, Field(ge=0, lt=1)] = Field(0.0, exclude_if=lambda value: not value)
    """Share of the radius of a labelled contact circle, inside its rim, whose pixels are not learned from.
    Circles are drawn by hand and some are too large: where the skin has left the ball already, its slopes are
    smaller than the ball's, which are steepest there."""
    flat_beyond: Annotated[float, Field(gt=1)] | None = Field(None, exclude_if=lambda value: value is None)
    """Distance from the centre of a labelled contact circle, in its radii, beyond which the skin is learned
    as the skin at rest, though light and colour differ there from the background: half of the pixels of
    flat_fraction are then such. Not given: nothing outside the circles is learned from but frames at rest."""
    still_share: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of the pixels whose slope the press leaves as it is that are trained on, chosen by chance. Most
    pixels are such, and a network that sees them all takes the gentle slopes under large or flat objects for
    none: forces on them come out too small."""
    finetune_epochs: Annotated[int, Field(ge=0)] = 3
    finetune_weights: bool = False
    """Fine-tune the hidden layers' weights too; worth it below 8 bits, with many epochs."""
    finetune_learning_rate: Positive = 0.05
    """In units of the last place of the integer weights."""
    force_epochs: Count = 60
    force_batch: Count = 8
    force_learning_rate: Positive = 1e-3
    force_weight_decay: Annotated[float, Field(ge=0)] = 1e-3

    @property
    def sums_learning_rate(self) -> float:
        """`depth_learning_rate`, or what it is where it is not given."""
        return self.depth_learning_rate or self.normals_learning_rate

    @property
    def force_light_noise(self) -> float:
        """`light_noise`, or what it is where it is not given: 0 with labels 'geometry'."""
        if self.labels == "geometry":
            return 0.0
        return LIGHT_NOISE if self.light_noise is None else self.light_noise

    @property
    def force_curl_weight(self) -> float:
        """`curl_weight`, or what it is where it is not given: 0 with labels 'geometry'."""
        if self.labels == "geometry":
            return 0.0
        return CURL_WEIGHT if self.curl_weight is None else self.curl_weight

    @property
    def force_reach(self) -> float:
        """`press_reach`, or what it is where it is not given: 0 with labels 'geometry'."""
        if self.labels == "geometry":
            return 0.0
        return PRESS_REACH if self.press_reach is None else self.press_reach

    @property
    def force_symmetry(self) -> bool:
        """`press_symmetry`, or what it is where it is not given: false with labels 'geometry'."""
        return self.labels == "force" and self.press_symmetry is not False

    @property
    def patience_sizes(self) -> int | None:
        """How many sizes of the force's smooth weights in a row may not lower the validation error before no
        larger one is tried; None: all are."""
        return PATIENCE_SIZES if self.labels == "force" else self.patience_epochs
