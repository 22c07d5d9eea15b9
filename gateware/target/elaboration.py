"""Elaborate an Amaranth design to Verilog or RTLIL (Yosys' intermediate language).

Three differences from Amaranth's own `verilog.convert`:

- Python's cyclic garbage collector is paused. A top-level at four pixels per clock is a netlist of a million
  objects that all stay alive; scanning them again and again would take a third of the time.
- Identical components, such as the lanes' tiles, become instances of one module (`shared_instances`).
- Source locations are left out, so that the text depends on the design alone, not on where it lies on disk.
"""

import gc
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from amaranth.back import rtlil, verilog
from amaranth.hdl import ClockSignal, Const, Elaboratable, Instance, Value
from amaranth.lib.wiring import Component, In

LINT_WAIVERS = Path(__file__).with_name("lint.vlt")
"""Verilator's findings that the written Verilog may have, for its -Wall."""
TOP_ATTRIBUTE = "attribute \\top 1\n"
"""RTLIL attribute of the top module; shared modules must not have it."""
RESET = re.compile(r"^(?!  wire |    connect \\rst 1'0$).*\\rst\b", re.MULTILINE)
"""A use of `rst` in RTLIL other than its declaration or a connection to constant 0."""


class SharedModules:
    """The shared modules of one design: their names, and those whose text is still to be written."""

    def __init__(self, design: str):
        self.design = design
        self.names: set[str] = set()
        self.waiting: list[tuple[str, Component]] = []

    def add(self, name: str, component: Component) -> str:
        """Register `component` as a module; returns the module's name. ValueError if `name` is taken."""
        module = f"{self.design}.shared.{name}"
        if module in self.names:
            raise ValueError(f"shared module {name}: expected a name that is not taken yet")
        self.names.add(module)
        self.waiting.append((module, component))
        return module


_shared_modules: ContextVar[SharedModules | None] = ContextVar("shared", default=None)
"""Those of the design being written; None otherwise, for example in Amaranth's simulator."""


def shared_instances(components: Sequence[Component], name: str) -> list[Elaboratable]:
    """Submodules to add instead of the identical `components`, each connected to its component's own ports.

    In `to_verilog` and `to_rtlil` they are instances of one module `name`, elaborated from the first
    component; elsewhere, or if there is only one, they are the components themselves. The module may use
    only the clock domain sync and registers without reset, which a `ResetInserter` around an instance could
    not reach.
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
    """The Verilog of `design` as module `name`, elaborated for `platform`; Amaranth's errors pass through."""
    return verilog_of(to_rtlil(design, name=name, platform=platform))


def verilog_of(rtlil_text: str) -> str:
    """The Verilog of the text that `to_rtlil` wrote."""
    # verilog.convert() calls this too, but takes a design, not RTLIL text; Amaranth's version is pinned.
    return verilog._convert_rtlil_text(rtlil_text)


def to_rtlil(
    design: Elaboratable,
    *,
    name: str = "top",
    platform: object = None,
    ports: object = None,
    sources: bool = False,
) -> str:
    """The RTLIL of `design` as module `name`, followed by its shared modules; otherwise as `to_verilog`.

    ports : for designs that are no components, as Amaranth's `rtlil.convert` takes them
    sources : whether every wire and cell names its place in the source
    """
    shared = SharedModules(name)
    outer = _shared_modules.set(shared)
    try:
        with garbage_collection_paused():
            texts = [rtlil.convert(design, name=name, platform=platform, ports=ports, emit_src=sources)]
            while shared.waiting:
                module, component = shared.waiting.pop()
                text = rtlil.convert(component, name=module, platform=platform, emit_src=sources)
                if RESET.search(text):
                    raise ValueError(f"shared module {module} resets a register: expected none with a reset")
                texts.append(text.replace(TOP_ATTRIBUTE, "", 1))
    finally:
        _shared_modules.reset(outer)
    return "".join(texts)


@contextmanager
def garbage_collection_paused() -> Iterator[None]:
    """Pause the cyclic garbage collector inside the block; restore its previous state afterwards."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
