"""The register map of one hardware, from its hardware.json, as the templates of this folder need it."""

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass

from fastac.gateware.bus.record import FORMAT_LOW, PLAIN, RecordFlag, RecordForm

REGISTER_BITS = 32
MAP_BYTES = 1 << 8
"""Address space of the registers."""


@dataclass(frozen=True)
class FieldView:
    """Bits `low` to `high` of a register; reset: their value after reset, None where it is not constant."""

    name: str
    low: int
    width: int
    reset: int | None

    @property
    def high(self) -> int:
        return self.low + self.width - 1

    @property
    def mask(self) -> int:
        return ((1 << self.width) - 1) << self.low


@dataclass(frozen=True)
class RegisterView:
    """A register as in gateware/bus/register_map.py, with the value after reset; None: it is not constant."""

    name: str
    offset: int
    access: str
    meaning: str
    reset: int | None
    read_changes: bool
    fields: tuple[FieldView, ...]

    @property
    def sentence(self) -> str:
        """The meaning as a text of its own; one that begins with a field's name keeps that as it is."""
        first, rest = self.meaning[0], self.meaning[1:]
        named = self.meaning.split()[0].endswith(":")
        return f"{first if named else first.upper()}{rest}."

    @property
    def whole(self) -> tuple[FieldView, ...]:
        """The fields; of a register without any one that is all of it."""
        return self.fields or (FieldView("value", 0, REGISTER_BITS, self.reset),)

    def lines(self, width: int) -> list[str]:
        """The meaning, broken into lines of up to `width` characters."""
        return textwrap.wrap(self.sentence, width)


def register_views(hardware: Mapping) -> list[RegisterView]:
    """The registers of what hardware.json says; raises KeyError for a key that it lacks."""
    found = []
    for register in hardware["registers"]:
        reset = register["reset"]
        fields = tuple(
            FieldView(
                field["name"],
                field["low"],
                field["width"],
                None if reset is None else reset >> field["low"] & (1 << field["width"]) - 1,
            )
            for field in register["fields"]
        )
        facts = [register[key] for key in ("name", "offset", "access", "meaning")]
        found.append(RegisterView(*facts, reset, register["read_changes"], fields))
    return found


def constants(hardware: Mapping) -> dict[str, int | float]:
    """Sizes and scales for a host's program, by names such as FRAME_HEIGHT_PX and DEPTH_MM_PER_LSB."""
    found: dict[str, int | float] = {"HARDWARE_VERSION": hardware["version"]}
    found |= _numbers("FRAME", hardware["frame"])
    for output in hardware["outputs"]:
        name, scale = output["name"].upper(), output["per_lsb"]
        found |= _numbers(name, output)
        per_word = scale if isinstance(scale, Mapping) else {} if scale is None else {"": scale}
        for axis, value in per_word.items():
            found[f"{name}_{f'{axis.upper()}_' if axis else ''}{output['unit'].upper()}_PER_LSB"] = value
    if hardware["force"]:
        for axis, value in hardware["force"]["newtons_per_lsb"].items():
            found[f"FORCE_{axis.upper()}_N_PER_LSB"] = value
    return found


def _numbers(prefix: str, table: Mapping) -> dict[str, int]:
    """The table's integers, with truth as 0 and 1."""
    return {f"{prefix}_{key.upper()}": int(value) for key, value in table.items() if isinstance(value, int)}


def record_fields(form: RecordForm = PLAIN) -> list[dict]:
    """The fields of a record of this form: C type, name, offset in bytes."""
    types = {"u4": "uint32_t", "u8": "uint64_t", "i8": "int64_t"}
    return [
        {"type": types[kind.str[1:]], "name": name, "offset": offset}
        for name, (kind, offset) in form.layout.fields.items()
    ]


def record_flags() -> dict[str, int]:
    """The flags of a record and their masks; FORMAT is the field of its layout's number."""
    return {flag.name: int(flag) for flag in RecordFlag} | {"FORMAT": 0xFF << FORMAT_LOW}


def c_number(value: int | float) -> str:
    """A literal of C: an unsigned integer, or a double that reads back as the same number."""
    if isinstance(value, int):
        return f"{value}u"
    if not math.isfinite(value):
        raise ValueError(f"{value}: expected a finite number")
    text = repr(value)
    return text if "e" in text or "." in text else f"{text}.0"
