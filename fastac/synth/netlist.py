"""The elaborated top-level in parts that synthesis takes one by one: each different module once."""

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

UNIT = "\\unit"
"""What the module to be synthesised is called in every part's RTLIL."""
ASSEMBLIES = ("", "datapath", "datapath.mlp", "datapath.solver", "datapath.force_stream")
"""Modules that are taken apart; what they hold beside their submodules is a part of its own."""

MODULE = re.compile(r"^(?:attribute [^\n]*\n)*module (\S+)\n.*?^end\n", re.MULTILINE | re.DOTALL)
CHILD = re.compile(r"^  cell (\\\S+) (\S+)$", re.MULTILINE)
OPERATOR = re.compile(r"^  (?:cell \$|process |memory )", re.MULTILINE)
PORT = re.compile(r"^  wire (.*?)\b(input|output) \d+ .*?(\\\S+)$", re.MULTILINE)
ELEMENT = re.compile(r"(?<=\S)\[(\d+)\]")
"""In a name; a slice of a signal has a space before it. nextpnr takes `o[2]` for bit 2 of `o`."""
PORT_NUMBER = re.compile(r"\b(input|output) \d+ ")
SERIAL = re.compile(r"(?<=\\port\$)\d+(?=\$)")
"""Of a port that Amaranth names itself, counted through the whole design."""


@dataclass(frozen=True)
class Port:
    """A port of a module: its RTLIL name, its width in bits, and whether it is an input."""

    name: str
    width: int
    is_input: bool


@dataclass
class Part:
    """A module of the design, the same text wherever it stands.

    name : path of its first instance, without the datapath's
    text : RTLIL of the module, called `UNIT`, and of its submodules
    own_logic : the submodules are black boxes, which belong to other parts
    instances : the paths of all instances
    to_place : the part as elaborated for the device on which it is placed, where that differs
    """

    name: str
    text: str
    own_logic: bool
    instances: list[str] = field(default_factory=list)
    to_place: "Part | None" = None

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()


def ports(text: str, module: str = UNIT) -> list[Port]:
    """The ports of a module in RTLIL, in the order of the text."""
    body = next(found[0] for found in MODULE.finditer(text) if found[1] == module)
    listed = []
    for kind, direction, name in PORT.findall(body):
        width = re.search(r"width (\d+)", kind)
        listed.append(Port(name, int(width[1]) if width else 1, direction == "input"))
    return listed


def _closure(modules: dict[str, str], name: str) -> list[str]:
    """A module and all below it."""
    found = [name]
    for current in found:
        found += [c for c, _ in CHILD.findall(modules[current]) if c in modules and c not in found]
    return found


def _black_box(modules: dict[str, str], name: str) -> str:
    """A module's ports alone."""
    wires = "".join(f"{line[0]}\n\n" for line in PORT.finditer(modules[name]))
    return f"attribute \\blackbox 1\nmodule {name}\n\n{wires}end\n"


def _sorted(text: str) -> str:
    """One module with its wires and ports by name: Amaranth's order follows from the surroundings."""
    blocks = [PORT_NUMBER.sub(r"\1 0 ", block) for block in text.split("\n\n")]
    places = [k for k, block in enumerate(blocks) if block.split("\n")[-1].startswith("  wire ")]
    number = 0
    for k, wire in zip(places, sorted(blocks[k] for k in places), strict=True):
        blocks[k], found = PORT_NUMBER.subn(rf"\1 {number} ", wire)
        number += found
    return "\n\n".join(blocks)


def _renamed(bodies: Iterable[str], name: str) -> str:
    """The modules with `name` called `UNIT`, and nothing left of where it stood."""
    text = "".join(_sorted(body.replace("attribute \\top 1\n", "")) for body in bodies)
    text = ELEMENT.sub(r".\1", text)
    serials = list(dict.fromkeys(SERIAL.findall(text)))
    text = SERIAL.sub(lambda found: str(serials.index(found[0])), text)
    return text.replace(f"{name}.", f"{UNIT}.").replace(f"{name}\n", f"{UNIT}\n")


def parts(text: str, top: str) -> list[Part]:
    """The different modules of a design in RTLIL with top module `top`, in the order of the hierarchy.

    `ASSEMBLIES` are taken apart; every other module stays whole with its submodules. A module that stands in
    several places, and modules of the same text, are one part with several instances.
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
