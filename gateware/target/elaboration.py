"""Elaboration of a design to Verilog or RTLIL.

Amaranth's netlist of a top at four pixels per clock has a million nets, each a Python object that lives until
the text is written. Python's cyclic garbage collector walks them all again and again and finds nothing to
free, a third of the time. It is paused meanwhile; reference counts still free what they can.

Amaranth would elaborate and write identical components, such as the lanes' tiles, one by one.
`shared_instances` makes them instances of one module.

Where in the sources a net comes from is left out: those are paths of this machine, and the text is to follow
from the design alone.
"""

import gc
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from amaranth.back import rtlil, verilog
from amaranth.hdl import ClockSignal, Const, Elaboratable, Instance, Value
from amaranth.lib.wiring import Component, In

TOP_ATTRIBUTE = "attribute \\top 1\n"
"""In RTLIL, of the module that a text is written for."""
RESET = re.compile(r"^(?!  wire |    connect \\rst 1'0$).*\\rst\b", re.MULTILINE)
"""A use of the reset in RTLIL, neither its declaration nor one that is never given."""


class SharedModules:
    """The modules that a design shares, named after it, and those of them whose text is still to write."""

    def __init__(self, design: str):
        self.design = design
        self.names: set[str] = set()
        self.waiting: list[tuple[str, Component]] = []

    def add(self, name: str, component: Component) -> str:
        """The module name of `component`; raises ValueError if another one has it."""
        module = f"{self.design}.shared.{name}"
        if module in self.names:
            raise ValueError(f"shared module {name}: expected a name that is not taken yet")
        self.names.add(module)
        self.waiting.append((module, component))
        return module


_shared_modules: ContextVar[SharedModules | None] = ContextVar("shared", default=None)
"""Of the design whose text is being written; None elsewhere, as in Amaranth's simulator."""


def shared_instances(components: Sequence[Component], name: str) -> list[Elaboratable]:
    """What to make submodules of in place of `components`, which do the same, each for its own signals.

    Where a text is written, several are instances of one module `name`, elaborated from the first. Registers
    in it are of domain sync and without a reset: a `ResetInserter` around an instance would not reach them.
    """
    shared = _shared_modules.get()
    if shared is None or len(components) == 1:
        return list(components)
    module = shared.add(name, components[0])
    domain = [("i", "clk", ClockSignal()), ("i", "rst", Const(0))]
    found = []
    for component in components:
        ports = [
            ("i" if member.flow == In else "o", "__".join(map(str, path)), Value.cast(value))
            for path, member, value in component.signature.flatten(component)
        ]
        found.append(Instance(module, *domain, *ports))
    return found


def to_verilog(design: Elaboratable, *, name: str = "top", platform: object = None) -> str:
    """Verilog of `design` as module `name`, its components elaborated for `platform`.

    What Amaranth raises of a faulty design passes through.
    """
    # What verilog.convert() calls, which takes one design; Amaranth's release is pinned.
    return verilog._convert_rtlil_text(to_rtlil(design, name=name, platform=platform))


def to_rtlil(design: Elaboratable, *, name: str = "top", platform: object = None) -> str:
    """RTLIL of `design`, Yosys' own form, as module `name`, and of what it shares; else as `to_verilog`."""
    shared = SharedModules(name)
    outer = _shared_modules.set(shared)
    try:
        with garbage_collection_paused():
            texts = [rtlil.convert(design, name=name, platform=platform, emit_src=False)]
            while shared.waiting:
                module, component = shared.waiting.pop()
                text = rtlil.convert(component, name=module, platform=platform, emit_src=False)
                if RESET.search(text):
                    raise ValueError(f"shared module {module} resets a register: expected none with a reset")
                texts.append(text.replace(TOP_ATTRIBUTE, "", 1))
    finally:
        _shared_modules.reset(outer)
    return "".join(texts)


@contextmanager
def garbage_collection_paused() -> Iterator[None]:
    """No cyclic garbage collection within; as it was before afterwards."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
