"""What one sensor and task require: the scene, read from TOML and validated.

Every other part derives from the scene what it must do, and does nothing else.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, ValidationError, model_validator

from fastac.scenes.watched import Watchable

AXES = "xyz"


CHANNELS = {"bgr": ("B", "G", "R"), "bgr+nir": ("B", "G", "R", "NIR")}
FORCES = {"force_x": (0,), "force_y": (1,), "force_z": (2,), "force_xyz": (0, 1, 2)}
"""The axes of each output that is a force."""
TANGENTIAL_SHARES = (0.3, 0.6)
"""The paper's (supplement, section I)."""
RECURRENCE_BEATS = 5
"""The tridiagonal solver's rows take at least as many clocks, for each row needs the one before it."""

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=2)]
Point = tuple[float, float]


class SceneError(ValueError):
    """A scene that cannot be used; the message is one line that names file, key and value."""


class Strict(Watchable):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Ellipsoid(Strict):
    """The skin at rest: the cap of an ellipsoid over the image, zero at the lowest corner of the image."""

    semi_axes_mm: tuple[Positive, Positive, Positive] = (12.0, 14.0, 9.0)


class Elastomer(Strict):
    """A soft layer bonded to a rigid skeleton and fixed at the rim of the image."""

    modulus_mpa: Positive = 0.4
    poisson_ratio: Annotated[float, Field(gt=0, lt=0.5)] = 0.48
    thickness_mm: Positive = 3.0
    thickness_variation: Annotated[float, Field(ge=0, lt=1)] = 0.3
    rim_mm: Positive = 1.5
    mechanics: Literal["layer", "fem"] = "layer"
    """layer: elastic and without friction, the skin moves along z only. fem: finite elements, all three axes,
    with friction."""
    friction: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Coulomb's coefficient between skin and indenter; with finite elements only."""
    elements: Annotated[int, Field(ge=4, le=96)] = 40
    """Finite elements along the image's longer side; the compliance takes memory as their fourth power."""
    layers: Annotated[int, Field(ge=1, le=16)] = 4
    """Finite elements through the thickness."""

    @model_validator(mode="after")
    def _friction_needs_elements(self):
        if self.friction and self.mechanics == "layer":
            raise ValueError(f"friction: {self.friction:g} needs mechanics 'fem'; a layer has none")
        return self


class Light(Strict):
    """Four sources behind the skeleton, at the corners, R opposite G and B opposite NIR, seen along z."""

    distance_mm: Positive = 14.0
    """From the image's axis to each source."""
    below_mm: Positive = 8.0
    """From the lowest corner of the skin down to the sources."""
    softening_mm: Annotated[float, Field(ge=0)] = 8.0
    """Size of the glow that the scattering skeleton makes of each source."""
    ambient: Annotated[float, Field(ge=0, lt=1)] = 0.15
    """Share of the light that arrives from everywhere."""
    specular: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of a source's light that the paint reflects like a rough mirror."""
    shininess: Annotated[float, Field(ge=1, le=200)] = 20.0
    """Exponent of that mirror's lobe."""
    cast_shadows: bool = False
    """Whether the skin's parts hide the sources from each other."""
    brightest_dn: Annotated[float, Field(gt=0, le=255)] = 150.0
    """Brightest pixel of the background, in each channel, in 8-bit digital numbers."""


class Markers(Strict):
    """Black dots on the skin, on a square grid, which move with it."""

    spacing_mm: Positive = 1.6
    radius_mm: Positive = 0.3
    contrast: Annotated[float, Field(gt=0, le=1)] = 0.9
    """Share of the light that a dot swallows."""

    @model_validator(mode="after")
    def _apart(self):
        if self.spacing_mm <= 2 * self.radius_mm:
            raise ValueError(
                f"spacing_mm: {self.spacing_mm:g} leaves no skin between dots of {self.radius_mm:g}"
            )
        return self


class Raw10(Strict):
    """The camera of RAW10 frames, an RGB-IR filter array seen at 4 × 4 raw pixels a pixel, and what makes
    B, G, R, NIR of its frames (models/vision/image_processing.py). In 10-bit digital numbers."""

    exposure: Annotated[float, Field(gt=0, le=1)] = 0.75
    """Share of an 8-bit frame's exposure: a visible pixel also has room for its crosstalk."""
    crosstalk: tuple[Share, Share, Share] = (0.8, 0.8, 0.8)
    """NIR response of B, G and R pixels over that of NIR pixels."""
    black_level_dn: Annotated[int, Field(ge=0, le=1022)] = 64
    electrons_per_dn: Positive = 8.0
    read_noise_dn: Annotated[float, Field(ge=0, le=1023)] = 1.0
    vignetting: Annotated[float, Field(ge=0, lt=0.99)] = 0.2
    dead_share: Annotated[float, Field(ge=0, le=0.1)] = 1e-4
    method: Literal["demosaic", "binning"] = "demosaic"
    """demosaic: the paper's list of steps. binning: the mean of each colour in a cell."""
    alpha: Annotated[float, Field(ge=0, le=4)] = 0.8
    beta: Annotated[float, Field(ge=1, le=1023)] = 1.0
    dead_pixel_dn: Positive = 128.0


class Sensor(Strict):
    geometry: Literal["fingertip", "flat"]
    height_px: Annotated[int, Field(ge=16, le=256)] = 128
    width_px: Annotated[int, Field(ge=16, le=256)] = 128
    pitch_mm: Positive = 0.125
    channels: Literal["bgr", "bgr+nir"] = "bgr+nir"
    frames: Literal["channels", "raw10"] = "channels"
    """What a dataset holds: channels, and nothing processes them, or the camera's RAW10 images."""
    source: Literal["simulated", "recorded"] = "simulated"
    ellipsoid: Ellipsoid = Ellipsoid()
    elastomer: Elastomer = Elastomer()
    light: Light = Light()
    markers: Markers | None = None
    """Without a table of this name the skin has no dots, and nothing tracks any."""
    noise_dn: Annotated[float, Field(ge=0)] = 1.0
    """Standard deviation of the camera's read noise in 8-bit digital numbers."""
    electrons_per_dn: Positive = 8.0
    """Photon noise: a value of n digital numbers stands for n times as many electrons, and varies by their
    root. 8 is a pixel of 8,000 electrons' full well at an analogue gain of 4, as short exposures need."""
    grain: Annotated[float, Field(ge=0, lt=0.3)] = 0.04
    """Standard deviation of the painted skin's albedo from pixel to pixel; the pattern is fixed."""
    raw10: Raw10 = Raw10()

    @model_validator(mode="after")
    def _raw10_is_used(self):
        if self.frames == "channels" and self.raw10 != Raw10():
            raise ValueError("raw10: settings of RAW10 frames need frames = 'raw10'")
        return self

    @property
    def channel_names(self) -> tuple[str, ...]:
        return CHANNELS[self.channels]


class Protocol(Strict):
    """Ball presses on three spatially disjoint grids (paper, supplement I)."""

    train_grid: Count = 8
    validation_grid: Count = 5
    test_grid: Count = 8
    loads_n: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.5, 1.0, 1.5)
    ball_mm: Positive = 5.0
    tangential_shares: tuple[Positive, ...] | None = None
    """Tangential loads, in shares of F_z, each in four directions, after each vertical one. Not given: the
    paper's 0.3 and 0.6 where tangential forces are wanted and the gel has friction, and else none."""
    corners_mm: tuple[Point, Point, Point, Point] | None = None
    """x, y of the corners of the region that is pressed: top left, top right, bottom left, bottom right as
    the image shows them; positions are bilinear between them. Not given: all but the rim and what a ball
    needs."""
    seed: Annotated[int, Field(ge=0)] = 1


class Network(Strict):
    """The pixel network: three hidden layers, then the normal."""

    width: Annotated[int, Field(ge=4, le=64)] = 16
    """Neurons of each hidden layer; 16 are the paper's."""

    @property
    def hidden(self) -> tuple[int, ...]:
        return (self.width,) * 3


class Numbers(Strict):
    """Word lengths. Widths that are not listed follow from computed bounds."""

    weight_bits: Annotated[int, Field(ge=3, le=8)] = 8
    last_weight_bits: Annotated[int, Field(ge=3, le=16)] = 12
    """Of the layer whose outputs are kept wide."""
    activation_bits: Annotated[int, Field(ge=3, le=10)] = 7
    """Of the hidden layers, unsigned. 7 are the paper's; up to 10, a product with an 8-bit weight still has
    the 18 bits that let a DSP48E2 hold two."""
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

    @property
    def slope_bits(self) -> int:
        """Of a slope with its sign: what `slope_limit` needs before the point, and the fraction behind it."""
        return self.gradient_fraction_bits + self.slope_limit.bit_length()


class Poisson(Strict):
    mode: Literal["absolute", "difference"] = "difference"
    """What is solved for: the depth itself, as in the paper, or its difference from rest: the same equation,
    but what the network finds at rest cancels exactly."""
    divergence: Literal["central", "backward"] = "central"
    solver: Literal["dst2d", "tridiagonal", "adjoint"] = "dst2d"
    """dst2d: sine transforms of rows and columns, the paper's. tridiagonal: of the rows alone; depth leaves
    last row first. adjoint: no depth at all; the force is a weighted sum of the slopes."""


class Force(Strict):
    kernel: Literal["patch", "collapsed"] = "patch"
    """patch: a K×K kernel at every pixel, which a force map needs. collapsed: the same resultant, to the
    bit, from one weight a pixel."""
    kernel_size: Literal[1, 3, 5, 7] = 5
    clamp: bool = True
    """Whether displacement away from the camera counts as zero, as in the paper."""
    fit: Literal["displacement", "slopes"] = "displacement"
    """What the model is trained on: the displacement, from which the adjoint's weights of the slopes follow,
    or, with the adjoint only, the slopes themselves."""
    hidden: Annotated[int, Field(ge=1, le=256)] = 32
    max_displacement_mm: Positive = 2.0


class Hardware(Strict):
    pixels_per_clock: Literal[1, 2, 4] = 1
    weights: Literal["loadable", "baked"] = "loadable"
    """Of the pixel network. loadable: in registers, written through AXI4-Lite, two products in a DSP48E2.
    baked: constants as shifts and additions, which need no DSP."""
    clock_mhz: Annotated[float, Field(gt=0, le=775)] = 150.0
    """The clock that latencies are converted with; an assumption until a board confirms it."""


class Training(Strict):
    labels: Literal["geometry", "force"] = "geometry"
    """What the pixel network learns from. geometry: normals. force: the force alone; network and weights of
    the slopes are then learned together, and the slopes mean nothing by themselves."""
    seed: Annotated[int, Field(ge=0)] = 1
    normals_epochs: Count = 30
    normals_batch_px: Count = 8192
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
    flat_fraction: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of background pixels in each epoch, where only contacts are labelled."""
    finetune_epochs: Annotated[int, Field(ge=0)] = 3
    finetune_weights: bool = False
    """Fine-tune the hidden layers' weights too; worth it below 8 bits, with many epochs."""
    finetune_learning_rate: Positive = 0.05
    """In units of the last place of the integer weights."""
    force_epochs: Count = 60
    force_batch: Count = 8
    force_learning_rate: Positive = 1e-3
    force_weight_decay: Annotated[float, Field(ge=0)] = 1e-3


class Simulation(Strict):
    frames: Annotated[int, Field(ge=2)] = 3
    """Held-out frames that go through the whole hardware."""


class Scene(Strict):
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
    outputs: Annotated[
        tuple[Literal["normals", "depth", "force_x", "force_y", "force_z", "force_xyz", "force_map"], ...],
        Field(min_length=1),
    ]
    sensor: Sensor
    protocol: Protocol = Protocol()
    network: Network = Network()
    numbers: Numbers = Numbers()
    poisson: Poisson = Poisson()
    force: Force = Force()
    hardware: Hardware = Hardware()
    training: Training = Training()
    simulation: Simulation = Simulation()

    @model_validator(mode="after")
    def _consistent(self):
        if len(set(self.outputs)) != len(self.outputs):
            raise ValueError("outputs: named twice")
        if "force_xyz" in self.outputs and {"force_x", "force_y", "force_z"} & set(self.outputs):
            raise ValueError("outputs: force_xyz has all three axes; name none beside it")
        lanes = self.hardware.pixels_per_clock
        if self.sensor.width_px % lanes:
            raise ValueError(
                f"hardware.pixels_per_clock: {lanes} does not divide sensor.width_px {self.sensor.width_px}"
            )
        from_displacement = self.wants_adjoint and self.force.fit == "displacement"
        if (self.wants_solver or from_displacement) and self.sensor.height_px != self.sensor.width_px:
            raise ValueError(
                f"sensor.height_px: {self.sensor.height_px} differs from width_px {self.sensor.width_px};"
                " the DST engine shares one matrix between rows and columns, so depth needs square images"
            )
        if self.wants_force_map and (
            not self.wants_force or self.force.kernel != "patch" or self.poisson.solver == "adjoint"
        ):
            raise ValueError(
                "outputs: force_map needs a force beside it, force.kernel 'patch', and a poisson.solver"
                " with depth"
            )
        if self.wants_solver and self.poisson.solver == "adjoint":
            raise ValueError("poisson.solver: 'adjoint' finds no depth; choose dst2d or tridiagonal")
        if self.wants_adjoint and self.force.clamp:
            raise ValueError("force.clamp: the adjoint is linear and cannot clamp; set clamp = false")
        if self.force.fit == "slopes" and self.poisson.solver != "adjoint":
            raise ValueError("force.fit: 'slopes' needs poisson.solver 'adjoint'")
        if self.training.labels == "force":
            self._force_alone()
        if self.protocol.tangential_shares and not self.sensor.elastomer.friction:
            raise ValueError(
                "protocol.tangential_shares: only friction carries them; set sensor.elastomer.friction and"
                " mechanics = 'fem'"
            )
        row_beats = -(-self.inner_px // lanes)
        if self.wants_solver and self.poisson.solver == "tridiagonal" and row_beats < RECURRENCE_BEATS:
            raise ValueError(
                f"poisson.solver: 'tridiagonal' needs rows of {RECURRENCE_BEATS} beats or more;"
                f" {self.inner_px} values at {lanes} pixels_per_clock are {row_beats}"
            )
        if self.sensor.geometry == "fingertip":
            a, b, _ = self.sensor.ellipsoid.semi_axes_mm
            half_u = self.sensor.width_px * self.sensor.pitch_mm / 2
            half_v = self.sensor.height_px * self.sensor.pitch_mm / 2
            if (half_u / a) ** 2 + (half_v / b) ** 2 >= 0.95:
                raise ValueError(
                    f"sensor.ellipsoid.semi_axes_mm: {a} x {b} do not span the image"
                    f" ({2 * half_u:g} x {2 * half_v:g} mm)"
                )
        return self

    def _force_alone(self) -> None:
        """Raise ValueError unless forces alone can train what is wanted."""
        if not self.wants_adjoint or "normals" in self.outputs or self.force.fit != "slopes":
            raise ValueError(
                "training.labels: 'force' gives forces only, no normals or depth, and needs poisson.solver"
                " 'adjoint' and force.fit 'slopes'"
            )
        for key in ("teachers", "flat_fraction", "position_noise"):
            value = getattr(self.training, key)
            if value:
                raise ValueError(f"training.{key}: {value} needs training.labels 'geometry'")

    @property
    def wants_solver(self) -> bool:
        """Whether anything that is asked for needs the depth."""
        return "depth" in self.outputs or (self.wants_force and self.poisson.solver != "adjoint")

    @property
    def wants_adjoint(self) -> bool:
        """Whether the force is found from the slopes, without depth."""
        return self.wants_force and self.poisson.solver == "adjoint"

    @property
    def wants_slopes(self) -> bool:
        return self.wants_solver or self.wants_adjoint

    @property
    def force_axes(self) -> tuple[int, ...]:
        """The axes of force that are wanted, in order: 0, 1, 2 for x, y, z."""
        return tuple(sorted(axis for name in self.outputs for axis in FORCES.get(name, ())))

    @property
    def wants_force(self) -> bool:
        return bool(self.force_axes)

    @property
    def tangential_shares(self) -> tuple[float, ...]:
        """Of F_z: the tangential loads of the protocol."""
        if self.protocol.tangential_shares is not None:
            return self.protocol.tangential_shares
        wanted = {0, 1} & set(self.force_axes) and self.sensor.elastomer.friction
        return TANGENTIAL_SHARES if wanted else ()

    @property
    def wants_force_map(self) -> bool:
        return "force_map" in self.outputs

    @property
    def inner_px(self) -> int:
        """Side of the region that the Poisson solver solves: the image less its one-pixel boundary."""
        return self.sensor.width_px - 2


def describe(error: ValidationError) -> str:
    """The first error of a validation, in one line: key, value, what is wrong."""
    first = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        return f"{key}: unknown key"
    if first["type"] == "missing":
        return f"{key}: missing"
    if not key:
        return message
    return f"{key} = {first['input']!r}: {message}"


def parse(text: str, *, origin: str, default_name: str | None = None) -> Scene:
    """The scene in a TOML text; `origin` names it in errors.

    Raises SceneError on TOML errors, unknown keys and impossible values.
    """
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{origin}: {error}") from None
    if default_name is not None:
        content.setdefault("name", default_name)
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        raise SceneError(f"{origin}: {describe(error)}") from None


def load(path: Path | str) -> Scene:
    """The scene in a TOML file, named after the file unless it names itself."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    return parse(text, origin=str(path), default_name=path.stem)
