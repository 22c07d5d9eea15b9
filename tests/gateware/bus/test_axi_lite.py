# amaranth: UnusedElaboratable=no
import pytest
from amaranth import Array, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from fastac.gateware.bus.axi_lite import AxiLiteSlave, Response, axi_lite_signature
from fastac.sim.runner import simulate


class Memory(wiring.Component):
    """Six words behind an AxiLiteSlave; the last one cannot be written."""

    def __init__(self, address_width):
        self.address_width = address_width
        super().__init__({"axil": In(axi_lite_signature(address_width))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.slave = slave = AxiLiteSlave(self.address_width)
        wiring.connect(m, wiring.flipped(self.axil), slave.axil)
        bus = slave.bus
        words = Array(Signal(32, name=f"word_{k}") for k in range(6))
        m.d.comb += [
            bus.read_data.eq(Mux(bus.read_word < 6, words[bus.read_word], 0)),
            bus.read_response.eq(Mux(bus.read_word < 6, Response.OKAY, Response.DECERR)),
            bus.write_response.eq(
                Mux(
                    bus.write_word < 5,
                    Response.OKAY,
                    Mux(bus.write_word == 5, Response.SLVERR, Response.DECERR),
                )
            ),
        ]
        with m.If(bus.write & (bus.write_word < 5)):
            word = words[bus.write_word]
            m.d.sync += word.eq((word & ~bus.write_mask) | (bus.write_data & bus.write_mask))
        return m


def test_accesses(tmp_path):
    simulate(Memory(6), "memory", "fastac.sim.benches.axi_lite", tmp_path, ADDRESS_WIDTH="6")


@pytest.mark.parametrize("width", [2, 33])
def test_invalid_address_width(width):
    with pytest.raises(ValueError, match=f"address_width {width}: expected 3 to 32"):
        AxiLiteSlave(width)
