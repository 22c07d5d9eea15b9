"""Ports and names of the modules in a Verilog text that Yosys wrote, one declaration a line."""

import re
from typing import NamedTuple


class Port(NamedTuple):
    """A port of `width` bits; direction: "in" or "out"."""

    name: str
    direction: str
    width: int


PORT = re.compile(r"^  (input|output) (?:\[(\d+):0\] )?\\?([^\s;]+) ?;$", re.MULTILINE)


def ports_of(text: str, module: str) -> list[Port]:
    """The ports of `module`, in the order of their declarations; ValueError where there is no such module."""
    found = re.search(rf"^module {re.escape(module)}\(.*?^endmodule$", text, re.MULTILINE | re.DOTALL)
    if found is None:
        raise ValueError(f"module {module!r}: expected one of this name in the Verilog")
    return [
        Port(name, direction.removesuffix("put"), int(high or 0) + 1)
        for direction, high, name in PORT.findall(found[0])
    ]


def renamed(text: str, module: str, name: str) -> str:
    """The text with its top `module`, and the modules below it that its name begins, named `name` instead.

    So that designs of several bundles can be parts of one design, in which no two modules have the same name.
    """
    top = rf"(?m)^module {re.escape(module)}(?=\()"
    return re.sub(rf"\\{re.escape(module)}\.", rf"\\{name}.", re.sub(top, f"module {name}", text))
