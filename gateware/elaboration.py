"""Elaboration of a design to Verilog or RTLIL.

Amaranth's netlist of a top at four pixels per clock has a million nets, each a Python object that lives until
the text is written. Python's cyclic garbage collector walks them all again and again and finds nothing to
free, a third of the time. It is paused meanwhile; reference counts still free what they can.

Where in the sources a net comes from is left out: those are paths of this machine, and the text is to follow
from the design alone.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from amaranth.back import rtlil, verilog
from amaranth.hdl import Elaboratable


@contextmanager
def collector_paused() -> Iterator[None]:
    """No cyclic garbage collection within; as it was before afterwards."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def to_verilog(design: Elaboratable, *, name: str = "top", platform: object = None) -> str:
    """Verilog of `design` as module `name`, its components elaborated for `platform`.

    What Amaranth raises of a faulty design passes through.
    """
    with collector_paused():
        return verilog.convert(design, name=name, platform=platform, emit_src=False)


def to_rtlil(design: Elaboratable, *, name: str = "top", platform: object = None) -> str:
    """RTLIL of `design`, Yosys' own form, as module `name`; else as `to_verilog`."""
    with collector_paused():
        return rtlil.convert(design, name=name, platform=platform, emit_src=False)
