"""The hardware's registers by name and field."""

import threading
from collections.abc import Callable

from fastac.driver.description import Description, FieldFacts, RegisterFacts

WORD_MASK = 0xFFFFFFFF
LATCHED = "_HIGH"
"""End of the names of registers that hold bits 63:32 of what the register with _LOW in its place begins with;
reading that one latches them."""


class Registers:
    """Registers of one core, through any transport's `read` and `write`. Safe to use from several threads.

    >>> registers.read("FRAME_COUNT")
    12
    >>> registers.read("STATUS", "busy")
    0
    >>> registers.write("CONTROL", enable=1, interrupt_enable=1)

    Raises ValueError, which names the register, for one that this hardware lacks, a field that it lacks, a
    value that does not fit, and an access that the register does not allow.
    """

    def __init__(
        self, description: Description, read: Callable[[int], int], write: Callable[[int, int], None]
    ):
        self._facts = {register.name: register for register in description.registers}
        self._errors = description.errors
        self._read, self._write = read, write
        self._lock = threading.RLock()

    def __contains__(self, name: str) -> bool:
        return name in self._facts

    def read(self, name: str, field: str | None = None) -> int:
        """The value of a register, or of one of its fields."""
        facts = self._known(name)
        bits = None if field is None else self._field(facts, field)
        with self._lock:
            value = self._read(facts.offset) & WORD_MASK
        return value if bits is None else value >> bits.low & ((1 << bits.width) - 1)

    def fields(self, name: str) -> dict[str, int]:
        """The values of all fields of a register, from one read."""
        facts, value = self._known(name), self.read(name)
        return {f.name: value >> f.low & ((1 << f.width) - 1) for f in facts.fields}

    def read_long(self, name: str, *, signed: bool = False) -> int:
        """The 64 bits of `name`_LOW and `name`_HIGH, which belong together."""
        with self._lock:  # another thread's read of LOW would latch another HIGH
            value = self.read(f"{name}_LOW") | self.read(name + LATCHED) << 32
        return value - (1 << 64) if signed and value >> 63 else value

    def write(self, name: str, value: int | None = None, **fields: int) -> None:
        """Write a register: `value`, or a value with these fields and 0 in all others."""
        facts = self._known(name)
        if facts.access == "ro":
            raise ValueError(f"{name}: is read-only")
        if value is None:
            value = 0
            for key, part in fields.items():
                bits = self._field(facts, key)
                if not 0 <= part < 1 << bits.width:
                    raise ValueError(f"{name}.{key} = {part}: expected {bits.width} bits")
                value |= part << bits.low
        if not 0 <= value <= WORD_MASK:
            raise ValueError(f"{name} = {value}: expected 32 bits")
        with self._lock:
            self._write(facts.offset, value)

    def take_errors(self) -> tuple[str, ...]:
        """The names of the errors that stand in ERRORS, which are cleared there."""
        with self._lock:
            value = self.read("ERRORS") & ((1 << len(self._errors)) - 1)
            if value:
                self.write("ERRORS", value)
        return tuple(name for bit, name in enumerate(self._errors) if value >> bit & 1)

    def _known(self, name: str) -> RegisterFacts:
        if name not in self._facts:
            raise ValueError(f"{name}: this hardware has no such register")
        return self._facts[name]

    def _field(self, facts: RegisterFacts, name: str) -> FieldFacts:
        for field in facts.fields:
            if field.name == name:
                return field
        names = ", ".join(field.name for field in facts.fields) or "none"
        raise ValueError(f"{facts.name}.{name}: no such field; there are {names}")
