"""The scene's table of training: labels, epochs, rates, noise, and what counts in the loss."""

from typing import Annotated, Literal

from pydantic import Field

from fastac.scenes.strict import Count, Positive, Strict

LIGHT_NOISE, CURL_WEIGHT = 0.01, 1.0
"""Of a training from forces alone whose scene does not say."""
PATIENCE_SIZES = 2
"""Of a training from forces alone, which fits smooth weights seven times: the largest sizes take most of the
time."""


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
    initial_weights: Literal["uniform", "active"] = Field(
        "uniform", exclude_if=lambda value: value == "uniform"
    )
    """Of the pixel network, with labels 'geometry'. uniform: drawn by chance, as PyTorch does. active:
    orthogonal, and each hidden neuron's activation begins at a pixel drawn by chance
    (models/training/initial_weights.py). Where most pixels are at rest some neurons are otherwise dead before
    training, more of them in one network than in another, and errors differ by as much."""
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
    force_starts: Count = Field(1, exclude_if=lambda value: value == 1)
    """Parameters that these start from: the trained network's, and others that differ a little. A dozen steps
    on half of the training presses, or on 1,600, from each tell by the error on as many others which goes on:
    some lead to poorer minima than others."""
    force_passes: Annotated[int, Field(ge=0)] = Field(0, exclude_if=lambda value: not value)
    """Passes over the training presses before these steps, in which least squares see a few presses at a time
    (models/training/whole_frames/force_filter.py). A pass takes about as long as a step and lowers the error
    further, and the last steps then end in better minima."""
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
    press_symmetry: bool | None = Field(None, exclude_if=lambda value: value is None)
    """Whether the force's weights may be such that a mirrored press has the mirrored force and, on a square
    image, a press turned by a quarter the same F_z, as on a gel that is alike in all directions, with labels
    'force'. They are where the network gives slopes of surfaces and that lowers the error on recordings left
    out of the last fit. Not with dots. Not given: true."""
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
    def learns_sums(self) -> bool:
        """Whether the network is trained on for what sums its slopes, the depth or the force."""
        return bool(self.depth_weight or self.force_weight or self.force_steps)

    @property
    def sums_learning_rate(self) -> float:
        """`depth_learning_rate`, or what it is where it is not given."""
        return self.depth_learning_rate or self.normals_learning_rate

    def _of_forces(self, key: str, default: float) -> float:
        """The value of a key of trainings from forces alone, `default` where it is not given."""
        if self.labels == "geometry":
            return 0.0
        value = getattr(self, key)
        return default if value is None else value

    @property
    def force_light_noise(self) -> float:
        """`light_noise`, or what it is where it is not given: 0 with labels 'geometry'."""
        return self._of_forces("light_noise", LIGHT_NOISE)

    @property
    def force_curl_weight(self) -> float:
        """`curl_weight`, or what it is where it is not given: 0 with labels 'geometry'."""
        return self._of_forces("curl_weight", CURL_WEIGHT)

    @property
    def force_symmetry(self) -> bool:
        """`press_symmetry`, or what it is where it is not given: false with labels 'geometry'."""
        return self.labels == "force" and self.press_symmetry is not False

    @property
    def patience_sizes(self) -> int | None:
        """How many sizes of the force's smooth weights in a row may not lower the validation error before no
        larger one is tried; None: all are."""
        return PATIENCE_SIZES if self.labels == "force" else self.patience_epochs
