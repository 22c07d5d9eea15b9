# amaranth: UnusedElaboratable=no
"""Wrappers for testbenches: a component whose table is written after reset, or with constant parameters."""

import numpy as np
from amaranth import Const, Module, Signal, unsigned
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect

from fastac.sim.check_stream import pack


class PreloadedTable(wiring.Component):
    """`component`, whose write port `table` gets `values` (depth, fields) of `bits` bits each after reset.

    Its input `i` waits until they are written. The wrapper has the component's streams `i` and `o` and its
    one-bit outputs named in `flags`.
    """

    def __init__(self, component, table: str, values: np.ndarray, bits: int, flags: tuple[str, ...] = ()):
        self.component, self.table, self.words, self.flags = component, table, pack(values, bits), flags
        super().__init__(
            {
                "i": In(component.i.signature.flip()),
                "o": Out(component.o.signature),
                **{name: Out(1) for name in flags},
            }
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.component = component = self.component
        port = getattr(component, self.table)
        m.submodules.words = words = Memory(
            shape=unsigned(len(port.data)), depth=len(self.words), init=self.words
        )
        read = words.read_port(domain="comb")
        address, done = Signal(range(len(self.words))), Signal()
        m.d.comb += [
            read.addr.eq(address),
            port.addr.eq(address),
            port.data.eq(read.data),
            port.en.eq(~done),
        ]
        with m.If(~done):
            m.d.sync += [address.eq(address + 1), done.eq(address == len(self.words) - 1)]
        connect(m, component.o, wiring.flipped(self.o))
        m.d.comb += [
            component.i.payload.eq(self.i.payload),
            component.i.valid.eq(self.i.valid & done),
            self.i.ready.eq(component.i.ready & done),
            *(getattr(self, name).eq(getattr(component, name)) for name in self.flags),
        ]
        return m


class ConstantParameters(wiring.Component):
    """`component` with its streams `i` and `o`, and the constant `image` at its port `parameters`."""

    def __init__(self, component, image: int):
        self.component, self.image = component, image
        super().__init__({"i": In(component.i.signature.flip()), "o": Out(component.o.signature)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.component = component = self.component
        connect(m, wiring.flipped(self.i), component.i)
        connect(m, component.o, wiring.flipped(self.o))
        m.d.comb += component.parameters.eq(Const(self.image, len(component.parameters)))
        return m
