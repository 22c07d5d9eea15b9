"""What one sensor and task require: the scene, read from TOML and validated.

Every other part derives from the scene what it must do, and does nothing else.
"""

import tomllib
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, ValidationError, model_validator

from fastac.scenes.checks import check_scene
from fastac.scenes.force_fits import FITS, FitFacts
from fastac.scenes.model_schema import Force, Network, Numbers, Poisson, Slip
from fastac.scenes.outputs import OUTPUTS, OutputFacts
from fastac.scenes.pace import Camera, Pace, PixelsPerClock, pace_of, slowest_pace
from fastac.scenes.parts import DEFAULT_PART
from fastac.scenes.sensor_schema import Sensor
from fastac.scenes.solvers import SOLVERS, SolverFacts
from fastac.scenes.strict import Count, Point, Positive, Strict
from fastac.scenes.training_schema import Training

AXES = "xyz"
SHOWN = 200
TANGENTIAL_SHARES = (0.3, 0.6)
"""The paper's (supplement, section I)."""


class SceneError(ValueError):
    """A scene that cannot be used; the message is one line that names file, key and value."""


class Protocol(Strict):
    """Ball presses on three spatially disjoint grids (paper, supplement I)."""

    train_grid: Count = 8
    validation_grid: Count = 5
    test_grid: Count = 8
    loads_n: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.5, 1.0, 1.5)
    loads_per_position: Annotated[Count | None, Field(exclude_if=lambda known: known is None)] = None
    """How many of loads_n each position of train and validation is pressed with, in turn, so that as many
    presses come to more positions. Not given: all. Each position of test is pressed with all."""
    ball_mm: Positive = 5.0
    more_balls_mm: tuple[Positive, ...] = ()
    """Diameters of further balls: each position of train and validation is pressed with one of them too, in
    turn. A force model that knows one shape only takes the others for more or less than they are."""
    more_shapes: tuple[Literal["cylinder", "edge", "punch", "lump"], ...] = ()
    """Kinds of further objects, each time of another random size (sensor/mechanics/random_indenter.py), in
    turn with more_balls_mm: as many presses, of more shapes."""
    tangential_shares: tuple[Positive, ...] | None = None
    """Tangential loads, in shares of F_z, each in four directions, after each vertical one. Not given: the
    paper's 0.3 and 0.6 where tangential forces are wanted and the gel has friction, and else none."""
    corners_mm: tuple[Point, Point, Point, Point] | None = None
    """x, y of the corners of the region that is pressed: top left, top right, bottom left, bottom right as
    the image shows them; positions are bilinear between them. Not given: all but the rim and what a ball
    needs."""
    seed: Annotated[int, Field(ge=0)] = 1

    @model_validator(mode="after")
    def _loads_are_enough(self):
        if (self.loads_per_position or 1) > len(self.loads_n):
            raise ValueError(
                f"loads_per_position: {self.loads_per_position}: expected at most the {len(self.loads_n)} of"
                " loads_n"
            )
        return self


class Hardware(Strict):
    pixels_per_clock: PixelsPerClock = 1
    """Pixels that enter in a clock. Fractions share multipliers over the clocks between two pixels, so that
    the hardware is smaller and what it computes the same. camera: the slowest that never makes the camera
    of sensor.frames_per_second wait."""
    weights: Literal["loadable", "baked"] = "loadable"
    """Of the pixel network. loadable: in registers, written through AXI4-Lite, two products in a DSP slice
    where they fit. baked: constants as shifts and additions, which need no DSP slice; at less than one pixel
    a clock constants in small memories, whose products share DSP slices as loadable ones do."""
    part: str = DEFAULT_PART
    """The FPGA, an entry of scenes/parts.py. It decides how products are packed, and designs that are too
    large for it are refused; what the hardware computes is the same on each."""
    clock_mhz: Annotated[float, Field(gt=0)] = 150.0
    """The clock that latencies are converted with; an assumption until a board confirms it. At most what the
    part's DSP slices and block RAMs reach."""
    bus_errors: Literal["flag", "respond"] = "flag"
    """How the registers refuse an access: by ERRORS.access_refused alone, or by an AXI error response too,
    which stops or crashes the software on most processors."""
    streams: Literal["video", "packets"] = "video"
    """How frames come in and images go out. video: lines with a start of frame, as video parts send and take
    them. packets: each frame and image is one packet, in widths that DMAs take, and images end with a record
    of the frame's result."""


class Simulation(Strict):
    frames: Annotated[int, Field(ge=2)] = 3
    """Held-out frames that go through the whole hardware."""


class Scene(Strict):
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
    outputs: Annotated[tuple[str, ...], Field(min_length=1)]
    """Entries of scenes/outputs.py."""
    sensor: Sensor
    protocol: Protocol = Protocol()
    network: Network = Network()
    numbers: Numbers = Numbers()
    poisson: Poisson = Poisson()
    force: Force = Force()
    slip: Slip = Slip()
    hardware: Hardware = Hardware()
    training: Training = Training()
    simulation: Simulation = Simulation()

    @model_validator(mode="after")
    def _consistent(self):
        check_scene(self)
        return self

    @property
    def output_facts(self) -> tuple[OutputFacts, ...]:
        """What the scene must know of its outputs."""
        return tuple(OUTPUTS[name] for name in self.outputs)

    @property
    def fit_facts(self) -> FitFacts:
        """What follows from how the force model is fitted."""
        return FITS[self.force.fit]

    @property
    def solver_facts(self) -> SolverFacts:
        """What follows from the Poisson solver."""
        return SOLVERS[self.poisson.solver]

    @property
    def camera_clocks_per_pixel(self) -> float | None:
        """Clocks between the camera's pixels; None where sensor.frames_per_second is not given."""
        sensor = self.sensor
        if sensor.frames_per_second is None:
            return None
        camera = Camera(
            sensor.height_px,
            sensor.width_px,
            sensor.frames_per_second,
            sensor.line_blanking_px,
            sensor.frame_blanking_lines,
        )
        return camera.clocks_per_pixel(self.hardware.clock_mhz)

    @property
    def pace(self) -> Pace:
        """How many pixels enter together, and how many clocks apart."""
        if self.hardware.pixels_per_clock == "camera":
            return slowest_pace(self.camera_clocks_per_pixel, self.sensor.width_px)
        return pace_of(self.hardware.pixels_per_clock)

    @property
    def lanes(self) -> int:
        """Pixels that enter together."""
        return self.pace.lanes

    @property
    def fold(self) -> int:
        """Clocks between two beats of pixels, over which multipliers are shared; 1: none is."""
        return self.pace.fold

    @property
    def felt_rounding_bits(self) -> int | None:
        """Bits of the activations whose rounding the float network feels in training; None: it feels none."""
        return self.numbers.activation_bits if self.training.rounding_noise else None

    @property
    def felt_weight_bits(self) -> int | None:
        """Bits of the hidden weights whose rounding it feels, on whole frames; None: it feels none."""
        return self.numbers.weight_bits if self.training.weight_rounding_noise else None

    @property
    def learns_force_of_slopes(self) -> bool:
        """Whether the network learns from a force that is a sum of its slopes. It then bends them, and they
        are no longer those of the skin."""
        learned = self.training.force_weight or self.training.force_steps
        return bool(learned) and self.fit_facts.of_slopes

    @property
    def finds_normals(self) -> bool:
        """Whether what the network finds are the skin's normals: what it learns from the force, alone or as a
        sum of its slopes, are other things."""
        return self.training.labels == "geometry" and not self.learns_force_of_slopes

    @property
    def wants_geometry(self) -> bool:
        """Whether normals, or what follows from them, are among the outputs, and not forces alone."""
        return any(facts.needs_geometry for facts in self.output_facts)

    @property
    def wants_solver(self) -> bool:
        """Whether anything that is asked for needs the depth."""
        needed = any(facts.needs_depth for facts in self.output_facts)
        return needed or self.force_from_displacement

    @property
    def force_from_slopes(self) -> bool:
        """Whether the force is a weighted sum of the slopes, without depth or beside it."""
        of_slopes = self.force.source == "slopes" or not self.solver_facts.finds_depth
        return self.wants_force and of_slopes

    @property
    def force_from_displacement(self) -> bool:
        """Whether the force is found from the solver's displacement."""
        return self.wants_force and not self.force_from_slopes

    @property
    def force_beside_depth(self) -> bool:
        """Whether depth is found too, and the force of the slopes does not wait for it."""
        return self.force_from_slopes and self.wants_solver

    @property
    def force_of_weights(self) -> bool:
        """Whether the force is a sum of one weight a pixel of the displacement, fitted as such."""
        return self.wants_force and self.fit_facts.of_weights

    @property
    def wants_slopes(self) -> bool:
        return self.wants_solver or self.force_from_slopes

    @property
    def force_axes(self) -> tuple[int, ...]:
        """The axes of force that are wanted, in order: 0, 1, 2 for x, y, z."""
        return tuple(sorted(axis for facts in self.output_facts for axis in facts.force_axes))

    @property
    def wants_force(self) -> bool:
        return bool(self.force_axes)

    @property
    def wants_interval(self) -> bool:
        """Whether each force comes with an interval around it."""
        return self.wants_force and self.force.coverage is not None

    @property
    def wants_bridge(self) -> bool:
        """Whether pixels under the marker dots take the slopes of the skin beside them."""
        return self.wants_slopes and self.network.bridge_dots

    @property
    def wants_dots(self) -> bool:
        """Whether the marker dots' shifts are a part of the force, so that hardware follows them."""
        return self.wants_force and self.force.dots

    @property
    def wants_slip(self) -> bool:
        """Whether the spread of the touching dots' shifts is wanted, which tells how near slip is."""
        return any(facts.needs_dots for facts in self.output_facts)

    @property
    def wants_darkness(self) -> bool:
        """Whether anything that is asked for needs to know which pixels are under dots."""
        return self.wants_dots or self.wants_bridge

    @property
    def tangential_shares(self) -> tuple[float, ...]:
        """Of F_z: the tangential loads of the protocol."""
        if self.protocol.tangential_shares is not None:
            return self.protocol.tangential_shares
        wanted = {0, 1} & set(self.force_axes) and self.sensor.elastomer.friction
        return TANGENTIAL_SHARES if wanted else ()

    @property
    def wants_force_map(self) -> bool:
        """Whether the force's contribution of each pixel is wanted, not only their sum."""
        return any(facts.needs_patches for facts in self.output_facts)

    @property
    def inner_px(self) -> int:
        """Side of the region that the Poisson solver solves: the image less its one-pixel boundary."""
        return self.sensor.width_px - 2


def _keys(path: tuple) -> list[str]:
    """The keys of the scene's table at this path, without the last part, which is none of them."""
    table = Scene
    for name in path[:-1]:
        field = getattr(table, "model_fields", {}).get(name)
        kinds = (field.annotation, *get_args(field.annotation)) if field else ()
        table = next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Strict)), None)
    return list(getattr(table, "model_fields", ()))


def describe(error: ValidationError) -> str:
    """A validation's first error in one line: key, value, what is wrong.

    An unknown key comes before all else, with the key that it may be meant for: a missing one may be just
    misspelt.
    """
    errors = error.errors(include_url=False)
    first = next((found for found in errors if found["type"] == "extra_forbidden"), errors[0])
    key = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        near = get_close_matches(str(first["loc"][-1]), _keys(first["loc"]), n=1)
        return f"{key}: unknown key" + "".join(f"; did you mean {name}?" for name in near)
    if first["type"] == "missing":
        return f"{key}: missing"
    if not key:
        return message
    return f"{key} = {shown(first['input'])}: {message}"


def shown(value: object) -> str:
    """A value as errors show it, in at most `SHOWN` characters."""
    try:
        text = repr(value)
    except ValueError:  # Python writes no integers of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def parse_toml(text: str) -> dict:
    """The content of a TOML text. Raises ValueError, in one line, for what is none or nested too deeply."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("values or tables are nested too deeply") from None


def parse(text: str, *, origin: str, default_name: str | None = None) -> Scene:
    """The scene in a TOML text; `origin` names it in errors.

    Raises SceneError on TOML errors, unknown keys and impossible values.
    """
    try:
        content = parse_toml(text)
    except ValueError as error:
        raise SceneError(f"{origin}: {error}") from None
    if default_name is not None:
        content.setdefault("name", default_name)
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        raise SceneError(f"{origin}: {describe(error)}") from None


def with_seed(scene: Scene, seed: int) -> Scene:
    """The scene, trained with another seed."""
    return scene.model_copy(update={"training": scene.training.model_copy(update={"seed": seed})})


def load(path: Path | str) -> Scene:
    """The scene in a TOML file, named after the file unless it names itself."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    return parse(text, origin=str(path), default_name=path.stem)
