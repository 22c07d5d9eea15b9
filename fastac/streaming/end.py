"""What a stream sends last, so that its readers end too: the message has two parts, b"end" and JSON.

This module needs nothing but Python.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from fastac.streaming import json_text

TOPIC = b"end"
FORMAT_VERSION = 1


class EndError(ValueError):
    """A message that is not the end of a stream; the message of the error is one line."""


@dataclass(frozen=True)
class End:
    """The end of a stream. frames : the number of its records, so that a reader knows what it has missed"""

    frames: int


def encode(end: End) -> list[bytes]:
    """The parts of the message."""
    return [TOPIC, json_text.write({"format_version": FORMAT_VERSION, "frames": end.frames})]


def decode(parts: Sequence[bytes | memoryview]) -> End:
    """The end in a message. Raises EndError."""
    if len(parts) != 2 or bytes(parts[0]) != TOPIC:
        raise EndError(f"message of {len(parts)} parts: not the end of a stream")
    try:
        return End(**json_text.values(json_text.read(parts[1], FORMAT_VERSION), {"frames": json_text.count}))
    except json_text.JsonError as error:
        raise EndError(f"end of a stream: {error}") from None
