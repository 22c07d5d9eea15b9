"""Partition of the elaborated top level into parts for synthesis one by one, equal modules only once."""

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

UNIT = "\\unit"
"""RTLIL name of the module to synthesise, in every part."""
ASSEMBLIES = ("", "datapath", "datapath.mlp", "datapath.solver", "datapath.force_stream")
"""Paths of modules that are split into their submodules; logic of their own becomes a separate part."""

MODULE = re.compile(r"^(?:attribute [^\n]*\n)*module (\S+)\n.*?^end\n", re.MULTILINE | re.DOTALL)
CHILD = re.compile(r"^  cell (\\\S+) (\S+)$", re.MULTILINE)
OPERATOR = re.compile(r"^  (?:cell \$|process |memory )", re.MULTILINE)
PORT = re.compile(r"^  wire (.*?)\b(input|output) \d+ .*?(\\\S+)$", re.MULTILINE)
ELEMENT = re.compile(r"(?<=\S)\[(\d+)\]")
"""Index within a name, which nextpnr would read as a bit of a signal; a true slice has a space before it."""
PORT_NUMBER = re.compile(r"\b(input|output) \d+ ")
SERIAL = re.compile(r"(?<=\\port\$)\d+(?=\$)")
"""Number in a port name that Amaranth generates; it counts through the whole design."""


@dataclass(frozen=True)
class Port:
    """A port of a module: its RTLIL name, its width in bits, and whether it is an input."""

    name: str
    width: int
    is_input: bool


@dataclass
class Part:
    """A module of the design, whose text does not depend on where it is instantiated.

    name : path of its first instance, without the prefix "datapath."
    text : RTLIL of the module, called `UNIT`, and of its submodules
    own_logic : whether the submodules are black boxes that belong to other parts
    instances : the paths of all instances
    to_place : the part as elaborated for the device of place-and-route, where that differs
    """

    name: str
    text: str
    own_logic: bool
    instances: list[str] = field(default_factory=list)
    to_place: "Part | None" = None

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def ports(text: str, module: str = UNIT) -> list[Port]:
    """The ports of a module in RTLIL `text`, in the order of the text."""
    body = next(found[0] for found in MODULE.finditer(text) if found[1] == module)
    listed = []
    for kind, direction, name in PORT.findall(body):
        width = re.search(r"width (\d+)", kind)
        listed.append(Port(name, int(width[1]) if width else 1, direction == "input"))
    return listed


def _closure(modules: dict[str, str], name: str) -> list[str]:
    """Names of a module and of all modules below it."""
    found = [name]
    for current in found:
        found += [c for c, _ in CHILD.findall(modules[current]) if c in modules and c not in found]
    return found


def _black_box(modules: dict[str, str], name: str) -> str:
    """A module reduced to its ports."""
    wires = "".join(f"{line[0]}\n\n" for line in PORT.finditer(modules[name]))
    return f"attribute \\blackbox 1\nmodule {name}\n\n{wires}end\n"


def _sorted(text: str) -> str:
    """A module with wires and ports sorted by name, since Amaranth's order depends on the surroundings.

    They come before all else, for a wire must be declared before its use.
    """
    blocks = [PORT_NUMBER.sub(r"\1 0 ", block) for block in text.split("\n\n")]
    is_wire = [block.split("\n")[-1].startswith("  wire ") for block in blocks]
    first = is_wire.index(True)
    wires, number = [], 0
    for wire in sorted(block for block, known in zip(blocks, is_wire, strict=True) if known):
        numbered, found = PORT_NUMBER.subn(rf"\1 {number} ", wire)
        wires.append(numbered)
        number += found
    others = [block for block, known in zip(blocks, is_wire, strict=True) if not known]
    return "\n\n".join([*others[:first], *wires, *others[first:]])


def _renamed(bodies: Iterable[str], name: str) -> str:
    """RTLIL of the modules with `name` renamed to `UNIT` and generated names renumbered: equal modules have
    equal text wherever they are instantiated."""
    text = "".join(_sorted(body.replace("attribute \\top 1\n", "")) for body in bodies)
    text = ELEMENT.sub(r".\1", text)
    serials = list(dict.fromkeys(SERIAL.findall(text)))
    text = SERIAL.sub(lambda found: str(serials.index(found[0])), text)
    return text.replace(f"{name}.", f"{UNIT}.").replace(f"{name}\n", f"{UNIT}\n")


def parts(text: str, top: str) -> list[Part]:
    """The different modules of a design in RTLIL with top module `top`, in the order of the hierarchy.

    `ASSEMBLIES` are split; every other module stays whole with its submodules. Modules of the same text are
    one part with several instances.
    """
    modules = {found[1]: found[0] for found in MODULE.finditer(text)}
    found: dict[str, Part] = {}

    def add(path: str, body: str, own_logic: bool) -> None:
        short = path.removeprefix("datapath.") or "top"
        name = f"{short} (own logic)" if own_logic else short
        part = Part(name, body, own_logic)
        found.setdefault(part.digest, part).instances.append(name)

    def visit(name: str, path: str) -> None:
        children = [(kind, cell) for kind, cell in CHILD.findall(modules[name]) if kind in modules]
        if not children or path not in ASSEMBLIES:
            add(path, _renamed((modules[m] for m in _closure(modules, name)), name), False)
            return
        for kind, cell in children:
            visit(kind, f"{path}.{cell[1:]}".removeprefix("."))
        if OPERATOR.search(modules[name]):
            boxes = [_black_box(modules, kind) for kind in dict.fromkeys(kind for kind, _ in children)]
            add(path, _renamed([modules[name], *boxes], name), True)

    visit(f"\\{top}", "")
    return list(found.values())
