"""Steps: a function, what it is given, and the names of what it writes."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

from fastac.store.digest import plain

VALUE = "value.json"
"""The output of a step that names none: what its function returns."""
_NAME = re.compile(r"[A-Za-z0-9_][\w.-]*")


class StepError(ValueError):
    """A step that cannot be performed as it is stated; the message is one line."""


class Settings(Protocol):
    """Settings that can tell what is read from them, such as a scene."""

    def watched(self, read: Callable[[str, object], None]) -> Self: ...

    def unwatched(self) -> Self: ...

    def value_at(self, path: str) -> object: ...

    def means_the_same(self, path: str, before: object) -> bool: ...


@dataclass(frozen=True, eq=False)
class Step:
    """`function(folder, **arguments, **unkeyed)` writes the outputs, files or folders, into `folder`.

    Arguments are plain values, paths (which count with their content), outputs of other steps, settings, and
    lists, tuples and dicts of these. `unkeyed` ones have no influence on the result, such as progress=True.
    A step without outputs returns its result as a value that JSON can express.
    """

    name: str
    function: Callable[..., object]
    arguments: Mapping[str, object] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    unkeyed: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self):
        function = self.function
        if "." in getattr(function, "__qualname__", ".") or "<" in function.__qualname__:
            raise StepError(f"step {self.name}: {function!r} is no function at the top level of a module")
        for name in (self.name, *self.outputs):
            if not _NAME.fullmatch(name):
                raise StepError(f"step {self.name}: {name!r} is no name; letters, digits, '_', '-', '.'")
        if VALUE in self.outputs or "step.json" in self.outputs:
            raise StepError(f"step {self.name}: {VALUE} and step.json are names of the store's own")
        both = sorted(self.arguments.keys() & self.unkeyed.keys())
        if both:
            raise StepError(f"step {self.name}: {', '.join(both)} given twice")

    def output(self, name: str) -> "Output":
        """One of the outputs, as an argument of another step."""
        if name not in self.outputs:
            known = ", ".join(self.outputs) or "none"
            raise StepError(f"step {self.name}: no output {name!r}; there is {known}")
        return Output(self, name)

    @property
    def written(self) -> tuple[str, ...]:
        return self.outputs or (VALUE,)

    @property
    def code(self) -> str:
        """Where the function is, `module:name`."""
        return f"{self.function.__module__}:{self.function.__qualname__}"


@dataclass(frozen=True, eq=False)
class Output:
    """What one step writes, for another."""

    step: Step
    name: str


def is_settings(value: object) -> bool:
    return hasattr(type(value), "watched") and hasattr(type(value), "value_at")


def needed_steps(step: Step) -> Iterator[Step]:
    """The steps whose outputs are arguments, each once."""
    found = [leaf for name, value in step.arguments.items() for _, leaf in leaves(value, name)]
    return iter({leaf.step: None for leaf in found if isinstance(leaf, Output)})


def leaves(value: object, place: str) -> Iterator[tuple[str, object]]:
    """Everything inside lists, tuples and dicts, with its place: `scenes[0]`; plain values in one piece."""
    for inner, item in _items(value):
        yield from leaves(item, f"{place}[{inner!r}]")
    if not _items(value):
        yield place, value


def assembled(value: object, place: str, given: Mapping[str, object]) -> object:
    """The argument again, with what `given` has at the leaves' places."""
    if not _items(value):
        return given[place]
    inside = {inner: assembled(item, f"{place}[{inner!r}]", given) for inner, item in _items(value)}
    return inside if isinstance(value, dict) else type(value)(inside.values())


def _items(value: object) -> list[tuple[object, object]]:
    """The parts of a container that holds more than plain values."""
    if type(value) not in (list, tuple, dict):
        return []
    pairs = list(value.items() if isinstance(value, dict) else enumerate(value))
    special = any(isinstance(item, Path | Output) or is_settings(item) or _items(item) for _, item in pairs)
    return pairs if special else []


def normalised(value: object, step: str, place: str) -> object:
    """A plain argument with Python's numbers instead of NumPy's."""
    try:
        return plain(value)
    except TypeError as error:
        raise StepError(f"step {step}: argument {place}: {error}") from None
