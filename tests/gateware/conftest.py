"""What several tests share: a loadable component as one with two streams, its parameters constant."""

import pytest
from amaranth import Const, Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out


class WithParameters(wiring.Component):
    """`component` between its streams `i` and `o`, `image` standing at its port `parameters`."""

    def __init__(self, component, image: int):
        self.component, self.image = component, image
        super().__init__({"i": In(component.i.signature.flip()), "o": Out(component.o.signature)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.component = component = self.component
        wiring.connect(m, wiring.flipped(self.i), component.i)
        wiring.connect(m, component.o, wiring.flipped(self.o))
        m.d.comb += component.parameters.eq(Const(self.image, len(component.parameters)))
        return m


@pytest.fixture
def with_parameters():
    return WithParameters
