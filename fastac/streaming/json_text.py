"""JSON objects as parts of messages, checked: Python alone writes and reads more than JSON has."""

import json
import math
import reprlib
from collections.abc import Callable
from typing import Any

Check = Callable[[Any], Any]
"""Takes one of JSON's values and gives Python's, or raises ValueError or OverflowError."""
WORD = 2**63
"""Integers are from -WORD to WORD - 1: any language's 64 bits hold them."""


class JsonError(ValueError):
    """Bytes that are not the JSON object that was expected; the message is half a line."""


def write(content: dict[str, Any]) -> bytes:
    """The object in one line. Raises ValueError for NaN and infinity, which JSON does not have."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode()


def read(octets: bytes | memoryview, version: int) -> dict[str, Any]:
    """The object, whose `format_version` must be `version`. Raises JsonError."""
    found = read_object(octets)
    if type(there := found.get("format_version")) is not int or there != version:
        raise JsonError(f"format_version = {reprlib.repr(there)}: this version reads {version}")
    return found


def read_object(octets: bytes | memoryview) -> dict[str, Any]:
    """The object. Raises JsonError."""
    try:
        found = json.loads(bytes(octets), parse_constant=_refuse)
    except (ValueError, RecursionError):
        raise JsonError("no JSON") from None
    if not isinstance(found, dict):
        raise JsonError("no JSON object")
    return found


def values(content: dict[str, Any], checks: dict[str, Check]) -> dict[str, Any]:
    """The values of the names in `checks`, checked. Raises JsonError where one is missing or wrong."""
    found = {}
    for name, check in checks.items():
        try:
            found[name] = check(content.get(name))
        except (ValueError, OverflowError):
            shown = reprlib.repr(content.get(name))
            raise JsonError(f"{name} = {shown}: missing, or not what it should be") from None
    return found


def _refuse(name: str) -> None:
    raise ValueError(f"{name}: JSON has no such number")


def _of(value: Any, kind: type) -> Any:
    if type(value) is not kind:
        raise ValueError
    return value


def flag(value: Any) -> bool:
    """true or false."""
    return _of(value, bool)


def text(value: Any) -> str:
    """A string."""
    return _of(value, str)


def whole(value: Any) -> int:
    """An integer of 64 bits."""
    if not -WORD <= _of(value, int) < WORD:
        raise ValueError
    return value


def count(value: Any) -> int:
    """An integer from 0 on."""
    if whole(value) < 0:
        raise ValueError
    return value


def number(value: Any) -> float:
    """A finite number; other languages may write 1.0 as 1."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError
    return float(value)


def several(one: Check) -> Check:
    """A list, which becomes a tuple."""
    return lambda value: tuple(one(item) for item in _of(value, list))


def by_name(one: Check) -> Check:
    """An object of values of one kind."""
    return lambda value: {name: one(item) for name, item in _of(value, dict).items()}


def or_none(one: Check) -> Check:
    """A value, or null."""
    return lambda value: None if value is None else one(value)
