# amaranth: UnusedElaboratable=no
"""Calibration images: what changes when a sensor's pixel network is retrained, as words for running hardware.

An image holds the network's parameters, what is computed from them (difference mode: the source offset of the
slopes at rest; absolute mode with a force: the depth at rest; adjoint: the constants), the limits of the
plausibility flags, how wide the interval around a force is, where marker dots are at rest, how dark they are
and the skin around them, and the bundle's hash. Everything else must equal that of the bundle from which the
hardware was built.
"""

import dataclasses
import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fastac.gateware.arithmetic.dsp_slice import DSP48E2
from fastac.gateware.bus.calibration_loader import CalibrationLoader, ImageLayout
from fastac.gateware.datapath import Datapath
from fastac.gateware.target.device import device_of, on_part
from fastac.models.integer.assemble import order_of_dots, with_force_of, with_loadable
from fastac.models.integer.bounds import Stage
from fastac.models.integer.bundle import LATER, Bundle, save
from fastac.models.integer.constant_neurons import with_hidden
from fastac.models.integer.depth import Depth
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_spread import DotSpread
from fastac.models.integer.dot_windows import DotWindows
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.force_interval import ForceInterval
from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import NEAREST

FORMAT_VERSION = 2
"""Version of the image format; part of the hardware identifier."""

OF_REST = "dots.rest_px"
"""Of a bundle's floats: where its dots are at rest, in the order of the integers'."""
LEVEL_LIGHT, SMOOTHING_PX = "scene.sensor.level_light", "scene.network.smoothing_px"
"""Names in `fixed_content` of what is done to pixels before the network."""
OF_DOTS = ("bridge", "follower", "dot_force", "spread")
"""Stages that only scenes with dots have."""


class CalibrationError(ValueError):
    """The bundle cannot be loaded into the hardware; the message is one line that names what differs."""


def _loaded_fields(pipeline: IntegerPipeline) -> dict[type, set[str]]:
    """For each class the fields that an image contains, or that only document the computation."""
    fields = {Layer: {"weight", "bias"}, Requantisation: {"multiplier", "shift"}, Stage: {"bound_px"}}
    fields[FrameValidity] = {"low", "high"}
    fields[DotWindows] = {"threshold"}
    fields[DotFollower] = {"rest", "guides", "low", "high"}
    fields[DotSpread] = {"place"}
    fields[ForceInterval] = {"weights", "base"}
    if pipeline.scene.poisson.mode == "difference":
        fields[PoissonSource] = {"offset"}
    else:
        fields[Depth] = {"rest"}
    if pipeline.scene.force_from_slopes:
        fields[WeightedSum] = {"constant"}
    return fields


def fixed_content(pipeline: IntegerPipeline) -> Iterator[tuple[str, object]]:
    """Name and value (plain or array) of everything in the hardware that a calibration cannot change."""
    scene, loaded = pipeline.scene, _loaded_fields(pipeline)
    yield "scene.outputs", sorted(scene.outputs)
    for name in ("height_px", "width_px", "pitch_mm", "channels"):
        yield f"scene.sensor.{name}", getattr(scene.sensor, name)
    yield LEVEL_LIGHT, scene.sensor.level_light
    yield SMOOTHING_PX, scene.network.smoothing_px
    for name in ("mode", "solver"):
        yield f"scene.poisson.{name}", getattr(scene.poisson, name)
    yield "scene.hardware.weights", scene.hardware.weights
    yield "scene.hardware.pixels_per_clock", scene.pace.value

    def content(name: str, value) -> Iterator[tuple[str, object]]:
        if dataclasses.is_dataclass(value):
            yield name, type(value).__name__
            for field in dataclasses.fields(value):
                part = getattr(value, field.name)
                if field.name not in loaded.get(type(value), ()):
                    yield from content(f"{name}.{field.name}", part)
                elif isinstance(part, np.ndarray):
                    yield f"{name}.{field.name}.shape", part.shape
        elif isinstance(value, tuple):
            yield f"{name}.length", len(value)
            for k, part in enumerate(value):
                yield from content(f"{name}.{k}", part)
        else:
            yield name, value

    stages = ("layers", "ratio", "source", "solver", "depth", "quantiser", "force", "validity")
    for name in (*stages, "bends", *OF_DOTS, "interval"):
        stage = getattr(pipeline, name)
        yield from content(name, stage)
        if hasattr(stage, "width"):
            yield f"{name}.width", stage.width


def hardware_identifier(pipeline: IntegerPipeline) -> int:
    """32-bit identifier of the hardware: hash of everything that a calibration cannot change.

    Rounding to nearest, dots, bends and smoothing that are not there, fields younger than bundles (`LATER`)
    as they were before, and DSP48E2, for which weights are packed as they always were, are left out, so that
    hardware older than the choice of them keeps its identifier. Levelled light is left out, too: hardware
    with it is older than its comparison.
    """
    digest = hashlib.sha256(f"calibration {FORMAT_VERSION}".encode())
    dsp = device_of(pipeline.scene).dsp
    if dsp is not DSP48E2:
        digest.update(f"packed for {dsp.name}".encode())
    for name, value in fixed_content(pipeline):
        if name == LEVEL_LIGHT or (name.endswith(".rounding") and value == NEAREST):
            continue
        field = name.rpartition(".")[2]
        if field in LATER and value == LATER[field]:
            continue
        if name in (SMOOTHING_PX, "validity.dots", "bends.length", *OF_DOTS) and not value:
            continue
        if isinstance(value, np.ndarray):
            digest.update(f"{name} {value.shape}".encode() + value.astype("<i8").tobytes())
        else:
            digest.update(f"{name} {value!r}".encode())
    return int.from_bytes(digest.digest()[:4], "big")


def first_difference(pipeline: IntegerPipeline, hardware: IntegerPipeline) -> str | None:
    """One line about the first fixed value in which `pipeline` and the hardware differ, or None."""
    for (name, new), (_, old) in zip(fixed_content(pipeline), fixed_content(hardware), strict=False):
        if not isinstance(new, np.ndarray):
            if new != old:
                return f"{name} = {new!r}: the hardware's is {old!r}"
        elif new.shape != old.shape:
            return f"{name} of shape {new.shape}: the hardware's is {old.shape}"
        elif not np.array_equal(new, old):
            count, place = int((new != old).sum()), tuple(map(int, np.argwhere(new != old)[0]))
            return (
                f"{name}: {count} of {new.size} values are not the hardware's,"
                f" the first in {place}: {new[place]}, the hardware's is {old[place]}"
            )
    return None


def _require(pipeline: IntegerPipeline, hardware: IntegerPipeline) -> None:
    if not hardware.layers[0].loadable:
        raise CalibrationError("hardware.weights: baked, the hardware takes no calibration")
    try:
        found = first_difference(pipeline, hardware)
    except ValueError as error:  # of places that slip cannot tell apart
        raise CalibrationError(str(error)) from None
    if found:
        raise CalibrationError(found)


def image_layout(path: Datapath) -> ImageLayout:
    """Layout of the images for the hardware with the loadable datapath `path`."""
    return ImageLayout(
        hardware_identifier(path.pipeline),
        {name: table for name, (table, _) in path.loadable_tables.items()},
        {name: bits for name, (bits, _) in path.loadable_registers.items()},
    )


def make_loader(path: Datapath, bundle_hash: int) -> CalibrationLoader:
    """The loader for `path`; its initial calibration is that of the bundle which `path` was built from."""
    registers = {name: value for name, (_, value) in path.loadable_registers.items()}
    return CalibrationLoader(image_layout(path), registers, bundle_hash)


def as_wide_as(pipeline: IntegerPipeline, hardware: IntegerPipeline) -> IntegerPipeline:
    """The pipeline with as many hidden neurons as the hardware has, those that it lacks without effect.

    Unchanged where it has more, which `first_difference` then finds.
    """
    if not hardware.layers[0].loadable or not pipeline.layers[0].loadable:
        return pipeline
    try:
        layers = with_hidden(pipeline.layers, hardware.hidden)
    except ValueError:
        return pipeline
    return with_loadable(pipeline.replace(layers=layers), True)


def with_hardware_force(bundle: Bundle, hardware: Bundle, folder: Path) -> Bundle:
    """`bundle` with the force of the bundle `hardware`, which an image cannot change; saved to `folder`.

    Training fits the force weights to the outputs of its own pixel network, so every training run has
    different ones. Dots are brought into the order of the hardware's, see `order_of_dots`. Raises
    CalibrationError if anything else also differs from the hardware.
    """
    if hardware.pipeline.force is None:
        raise CalibrationError(f"scene.outputs = {hardware.scene.outputs}: the hardware has no force to keep")
    known = hardware.pipeline
    pipeline = as_wide_as(bundle.pipeline, known)
    of_force = dict.fromkeys(("force", "validity", "follower", "dot_force", "interval"))
    _require(pipeline.replace(**of_force), known.replace(**of_force))
    floats = {k: v for k, v in bundle.floats.items() if "force" not in k}
    floats |= {k: v for k, v in hardware.floats.items() if "force" in k}
    try:
        kept = with_force_of(pipeline, known)
        if OF_REST in floats:
            floats[OF_REST] = floats[OF_REST][order_of_dots(pipeline, known)]
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    _require(kept, known)
    return save(folder, kept, floats)


def calibration_words(bundle: Bundle, hardware: Bundle) -> np.ndarray:
    """The image, uint32 words, that makes hardware built from `hardware` compute as `bundle` does.

    `bundle` may be of a scene for another part: its weights are packed as those of the hardware. Its network
    may have fewer hidden neurons, as after pruning.
    Raises CalibrationError, naming the first difference, if `bundle` differs in something fixed, or naming a
    dot that is where the hardware cannot follow it.
    """
    pipeline = as_wide_as(bundle.pipeline, hardware.pipeline)
    _require(pipeline, hardware.pipeline)
    try:
        path = Datapath(on_part(pipeline, hardware.scene.hardware.part))
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    return image_layout(path).image(
        {name: values for name, (_, values) in path.loadable_tables.items()},
        {name: value for name, (_, value) in path.loadable_registers.items()},
        bundle.hash_word,
    )
