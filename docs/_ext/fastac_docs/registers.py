"""The registers in Markdown, from the register map: addresses, fields, meanings, and a result's record."""

import re

from fastac.gateware.bus.record import FORMAT_LOW, RECORD_BYTES, RecordFlag
from fastac.gateware.bus.register_map import REGISTERS, Field, Register
from fastac.gateware.target.register_files.register_view import record_fields

ACCESS = {
    "ro": "read only",
    "rw": "read and write",
    "w1c": "read, and write 1 to clear",
    "wo": "write only, reads as 0",
}
NEEDS = {
    "": "always",
    "results": "frames in packets",
    "calibration": "weights that can be loaded",
}
"""When a register exists; the others need an output of their name."""


def register_id(name: str) -> str:
    """The anchor of a register in the page of registers."""
    return f"register-{name.lower().replace('_', '-')}"


def registers() -> str:
    """A table of all registers, a section for each, and the record."""
    rows = [
        f"| `0x{r.offset:02x}` | [`{r.name}`](#{register_id(r.name)}) | {r.access} | {_exists(r)} |"
        for r in REGISTERS
    ]
    head = ["| offset | register | access | exists with |", "|---|---|---|---|", *rows]
    return "\n\n".join(["\n".join(head), *(_section(register) for register in REGISTERS), _record()])


def _exists(register: Register) -> str:
    return NEEDS.get(register.needs, f"output {register.needs.replace('_', ' ')}")


def _section(register: Register) -> str:
    parts = [
        f"({register_id(register.name)})=\n\n## {register.name}",
        f"Offset `0x{register.offset:02x}`, {ACCESS[register.access]}; exists with: {_exists(register)}.",
    ]
    named, text = meanings(register)
    if text:
        parts.append(f"{text[0].upper()}{text[1:]}.")
    if register.fields:
        rows = [
            f"| {_bits(field)} | `{field.name}` | `0x{((1 << field.width) - 1) << field.low:08x}` |"
            f" {named.get(field.name, '')} |"
            for field in register.fields
        ]
        parts.append("\n".join(["| bits | field | mask | meaning |", "|---|---|---|---|", *rows]))
    if register.read_changes:
        parts.append("Reading it changes what it, or its other half, reads as next.")
    return "\n\n".join(parts)


def _bits(field: Field) -> str:
    return str(field.low) if field.width == 1 else f"{field.low + field.width - 1}:{field.low}"


def meanings(register: Register) -> tuple[dict[str, str], str]:
    """{field: its meaning} and the rest of the register's meaning, which says them all in one text.

    There "name: text" is the meaning of a field; "one, other: text" of several, "line_…: text" of those
    that begin so, and "The others: text" of those that have none yet. Other sentences are the register's own.
    """
    names = {field.name for field in register.fields}
    found: dict[str, str] = {}
    rest = []
    for sentence in re.split(r"(?<=\.) (?=[\w…, ]+: |[A-Z])", f"{register.meaning}."):
        head, colon, text = sentence.partition(": ")
        wanted = head.split(", ")
        fields = {
            name
            for name in names
            for part in wanted
            if name == part or (part.endswith("…") and name.startswith(part.removesuffix("…")))
        }
        if head == "The others":
            fields = names - found.keys()
        if colon and fields:
            found |= dict.fromkeys(fields, text.removesuffix("."))
        else:
            rest.append(sentence.removesuffix("."))
    return found, ". ".join(rest)


def _record() -> str:
    rows = [f"| {f['offset']} | `{f['type']}` | `{f['name']}` |" for f in record_fields()]
    flags = [f"| `0x{int(flag):04x}` | `{flag.name.lower()}` |" for flag in RecordFlag]
    return "\n".join(
        [
            "## The record of a result",
            "",
            f"{RECORD_BYTES} bytes, little-endian: word by word from `RESULTS_WORD`, and in memory behind"
            " each image of a packet.",
            "",
            "| byte | type | field |",
            "|---|---|---|",
            *rows,
            "",
            f"Bits of `flags`; bits {FORMAT_LOW + 7}:{FORMAT_LOW} are the format's number:",
            "",
            "| mask | flag |",
            "|---|---|",
            *flags,
        ]
    )
