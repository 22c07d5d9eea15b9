"""A sweep's specification in TOML: which keys of a scene take which values; and the points that follow."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from fastac.scenes import schema as scenes
from fastac.scenes.schema import Scene
from fastac.scenes.strict import Count, Strict

FileName = Annotated[str, Field(pattern=r"^[^\x00-\x1f]+$")]
Values = Annotated[list, Field(min_length=1)]
Axes = Annotated[dict[str, Values], Field(min_length=1)]

UNSET = "unset"
"""Value of an axis with which a key has its default, as if no scene had set it: TOML has no word for none."""


class SpecError(ValueError):
    """A specification that cannot be used; the message is one line that names file, key and value."""


class Spec(Strict):
    """A sweep's specification. Paths are relative to the file that it was read from.

    An axis is a scene's key with its values: "numbers.data_bits" = [18, 22, 26]. Several keys separated by
    commas form one axis: a value applies to all of them or, if it is a list with one entry per key, entry by
    entry. The value "unset" gives a key its default, as that of `force.band_mm`, which is none. The axis
    "scene" takes the files of other base scenes.
    """

    scene: FileName
    """File of the base scene, which gives all keys that no axis sets."""
    set: Annotated[dict[str, object], Field(default_factory=dict)]
    """Values by key that the base scene has in this sweep in place of its own."""
    axes: Annotated[list[Axes], Field(min_length=1)]
    """One grid or, as [[axes]], several, whose points are merged."""
    method: Literal["grid", "optuna"] = "grid"
    data: FileName | None = None
    """Dataset for all points, instead of simulated frames."""
    split: Literal["train", "validation", "test"] = "test"
    frames: Count = 48
    """Number of the split's frames, evenly spaced, on which every point is evaluated."""
    trials: Count = 100
    """Number of points that Optuna tries."""
    seed: Annotated[int, Field(ge=0)] = 1
    objectives: Annotated[tuple[str, ...], Field(min_length=1)] = ("depth_mae_mm", "latency_cycles", "dsp")
    """Metrics that Optuna minimises together."""


@dataclass(frozen=True)
class Point:
    """A point of the design space.

    axes : values by key of the scene; the key "scene" gives the file of another base scene
    scene : the resulting scene, None where the values are impossible; then `error` says why
    """

    axes: dict
    scene: Scene | None
    error: str = ""

    @property
    def content(self) -> dict:
        """What the point's result depends on, as JSON: the scene without its name and simulation settings."""
        if self.scene is None:
            return {"impossible": self.axes}
        return self.scene.model_dump(mode="json", exclude={"name", "simulation"})


def _is_scene_key(key: str) -> bool:
    """Whether a dotted key is in the scene's schema and may be swept."""
    model, (*outer, last) = Scene, key.split(".")
    for name in outer:
        found = model.model_fields.get(name)
        if (
            found is None
            or not isinstance(found.annotation, type)
            or not issubclass(found.annotation, Strict)
        ):
            return False
        model = found.annotation
    return last in model.model_fields and last != "name"


def keys_of(axis: str) -> list[str]:
    """The scene's keys in the name of an axis."""
    return [key.strip() for key in axis.split(",")]


def expand(axis: str, value) -> dict:
    """By key, the values that one value of an axis sets."""
    keys = keys_of(axis)
    each = isinstance(value, list) and len(keys) > 1
    return dict(zip(keys, value if each else [value] * len(keys), strict=True))


def _check_key(key: str, place: str) -> None:
    """Raise SpecError, beginning with `place`, for a key that is not in the scene's schema."""
    if not _is_scene_key(key):
        raise SpecError(f"{place}: {key!r}: a scene has no such key")


def _check_value(value: object, key: str, place: str) -> None:
    """Raise SpecError, beginning with `place`, for what no key of a scene can be."""
    if key == "scene" and not (isinstance(value, str) and value.isprintable()):
        raise SpecError(f"{place}: {scenes.shown(value)}: expected the name of a scene's file")
    try:
        json.dumps(value)
    except (TypeError, ValueError):  # dates, which only TOML knows, and integers of thousands of digits
        raise SpecError(f"{place}: {scenes.shown(value)}: expected numbers, texts or lists of them") from None


def load(path: Path) -> tuple[Spec, Scene]:
    """Read a specification and its base scene. Raises SpecError, or SceneError for the scene."""
    try:
        content = scenes.parse_toml(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SpecError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if isinstance(content.get("axes"), dict):
        content["axes"] = [content["axes"]]
    try:
        spec = Spec.model_validate(content)
    except ValidationError as error:
        raise SpecError(f"{path}: {scenes.describe(error)}") from None
    for grid in spec.axes:
        for axis, values in grid.items():
            keys = keys_of(axis)
            for key in keys:
                if key != "scene":
                    _check_key(key, f"{path}: axes")
            for value in values:
                if len(keys) > 1 and isinstance(value, list) and len(value) != len(keys):
                    wrong = f"{axis!r}: {scenes.shown(value)}"
                    raise SpecError(f"{path}: axes: {wrong}: expected {len(keys)} values")
                for key, one in expand(axis, value).items():
                    _check_value(one, key, f"{path}: axes: {axis!r}")
    if spec.method == "optuna" and len(spec.axes) > 1:
        raise SpecError(f"{path}: method = 'optuna': expected one table of axes")
    return spec, _base(spec, path)


def _base(spec: Spec, path: Path) -> Scene:
    """The base scene with the values of `set`."""
    base = scenes.load(path.parent / spec.scene)
    if not spec.set:
        return base
    if any("scene" in keys_of(axis) for grid in spec.axes for axis in grid):
        raise SpecError(f"{path}: set: expected no axis 'scene' beside it, whose files it would not change")
    for key, value in spec.set.items():
        _check_key(key, f"{path}: set")
        _check_value(value, key, f"{path}: set: {key!r}")
    found = point_of(base, spec.set, path.parent)
    if found.scene is None:
        raise SpecError(f"{path}: set: {found.error}")
    return found.scene


def point_of(base: Scene, choice: dict, folder: Path) -> Point:
    """The point with the values `choice` on top of the base scene; `folder` is that of the specification.

    Raises SceneError for another base scene that cannot be read.
    """
    if "scene" in choice:
        base = scenes.load(folder / choice["scene"])
    content = base.model_dump(mode="json")
    for key, value in choice.items():
        if key == "scene":
            continue
        inner, (*outer, last) = content, key.split(".")
        for name in outer:
            inner = inner[name]
        if value == UNSET:
            inner.pop(last, None)
        else:
            inner[last] = value
    try:
        return Point(choice, Scene.model_validate(content))
    except ValidationError as error:
        return Point(choice, None, scenes.describe(error))


def grid(spec: Spec, base: Scene, folder: Path) -> Iterator[Point]:
    """All points of all grids; equal points once."""
    seen = set()
    for axes in spec.axes:
        for values in product(*axes.values()):
            choice = {}
            for axis, value in zip(axes, values, strict=True):
                choice |= expand(axis, value)
            point = point_of(base, choice, folder)
            key = digest(point.content)
            if key not in seen:
                seen.add(key)
                yield point


def digest(content) -> str:
    """SHA-256 of JSON content, its first 32 hexadecimal digits."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]
