# amaranth: UnusedElaboratable=no
"""A calibration: what changes when a sensor's pixel network is trained anew, as words for hardware that runs.

It is the network, what follows from it (the source of the slopes at rest in difference mode, the depth at
rest in absolute mode where a force is wanted, the adjoint's constants), the limits beyond which frames are
suspect, and the bundle's hash. All else must
be as in the bundle that the hardware was made from.
"""

import dataclasses
import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fastac.gateware.bus.calibration_loader import CalibrationLoader, ImageLayout
from fastac.gateware.datapath import Datapath
from fastac.models.integer.assemble import with_force_of
from fastac.models.integer.bounds import Stage
from fastac.models.integer.bundle import Bundle, save
from fastac.models.integer.depth import Depth
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import NEAREST

FORMAT_VERSION = 2
"""Of the images."""


class CalibrationError(ValueError):
    """A bundle that is no calibration for the hardware; the message is one line that names what differs."""


def _loaded_fields(pipeline: IntegerPipeline) -> dict[type, set[str]]:
    """The fields of each class that a calibration brings, or that only explain it."""
    fields = {Layer: {"weight", "bias"}, Requantisation: {"multiplier", "shift"}, Stage: {"bound_px"}}
    fields[FrameValidity] = {"low", "high"}
    if pipeline.scene.poisson.mode == "difference":
        fields[PoissonSource] = {"offset"}
    else:
        fields[Depth] = {"rest"}
    if pipeline.scene.force_from_slopes:
        fields[WeightedSum] = {"constant"}
    return fields


def fixed_content(pipeline: IntegerPipeline) -> Iterator[tuple[str, object]]:
    """Everything in the hardware that a calibration leaves as it is, by name: plain values and arrays."""
    scene, loaded = pipeline.scene, _loaded_fields(pipeline)
    yield "scene.outputs", sorted(scene.outputs)
    for name in ("height_px", "width_px", "pitch_mm", "channels"):
        yield f"scene.sensor.{name}", getattr(scene.sensor, name)
    for name in ("mode", "solver"):
        yield f"scene.poisson.{name}", getattr(scene.poisson, name)
    for name in ("weights", "pixels_per_clock"):
        yield f"scene.hardware.{name}", getattr(scene.hardware, name)

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

    for name in ("layers", "ratio", "source", "solver", "depth", "quantiser", "force", "validity"):
        stage = getattr(pipeline, name)
        yield from content(name, stage)
        if hasattr(stage, "width"):
            yield f"{name}.width", stage.width


def hardware_identifier(pipeline: IntegerPipeline) -> int:
    """32 bits that tell hardware apart: the hash of everything that a calibration leaves as it is.

    Rounding to the nearest is not in it: hardware from before there was a choice stays what it is.
    """
    digest = hashlib.sha256(f"calibration {FORMAT_VERSION}".encode())
    for name, value in fixed_content(pipeline):
        if name.endswith(".rounding") and value == NEAREST:
            continue
        if isinstance(value, np.ndarray):
            digest.update(f"{name} {value.shape}".encode() + value.astype("<i8").tobytes())
        else:
            digest.update(f"{name} {value!r}".encode())
    return int.from_bytes(digest.digest()[:4], "big")


def first_difference(pipeline: IntegerPipeline, hardware: IntegerPipeline) -> str | None:
    """The first thing that keeps a calibration with `pipeline` from the hardware; None if it fits."""
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
    found = first_difference(pipeline, hardware)
    if found:
        raise CalibrationError(found)


def image_layout(path: Datapath) -> ImageLayout:
    """Of the images for the hardware with `path`, which is loadable."""
    return ImageLayout(
        hardware_identifier(path.pipeline),
        {name: table for name, (table, _) in path.loadable_tables.items()},
        {name: bits for name, (bits, _) in path.loadable_registers.items()},
    )


def make_loader(path: Datapath, bundle_hash: int) -> CalibrationLoader:
    """The loader for `path`; it starts with the calibration that `path` was made from."""
    registers = {name: value for name, (_, value) in path.loadable_registers.items()}
    return CalibrationLoader(image_layout(path), registers, bundle_hash)


def with_hardware_force(bundle: Bundle, hardware: Bundle, folder: Path) -> Bundle:
    """`bundle` with the force of `hardware`, which a calibration cannot bring; written to `folder`.

    Training fits the force to what its own pixel network finds, so that each training has other weights.
    Raises CalibrationError where that is not all that keeps `bundle` from the hardware.
    """
    if hardware.pipeline.force is None:
        raise CalibrationError(f"scene.outputs = {hardware.scene.outputs}: the hardware has no force to keep")
    _require(bundle.pipeline.replace(force=hardware.pipeline.force), hardware.pipeline)
    floats = {k: v for k, v in bundle.floats.items() if "force" not in k}
    floats |= {k: v for k, v in hardware.floats.items() if "force" in k}
    return save(folder, with_force_of(bundle.pipeline, hardware.pipeline), floats)


def calibration_words(bundle: Bundle, hardware: Bundle) -> np.ndarray:
    """The image, uint32 words, that makes the hardware of bundle `hardware` compute as `bundle` does.

    Raises CalibrationError, naming the first thing that differs, where a calibration cannot do that.
    """
    _require(bundle.pipeline, hardware.pipeline)
    path = Datapath(bundle.pipeline)
    return image_layout(path).image(
        {name: values for name, (_, values) in path.loadable_tables.items()},
        {name: value for name, (_, value) in path.loadable_registers.items()},
        bundle.hash_word,
    )
