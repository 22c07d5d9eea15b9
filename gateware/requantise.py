"""From a layer's accumulators to the next layer's activations."""

from amaranth import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from models.integer import Requantisation


class RequantiseCore(wiring.Component):
    """Requantise one accumulator of every neuron a clock, without a handshake.

    Members
    -------
    advance : the registers move in clocks in which it is high
    i : `len(scale.multiplier)` accumulators, signed(width)
    o : as many activations, unsigned(scale.bits)

    The activations stand in `o` after `latency` = 3 advances.
    """

    latency = 3

    def __init__(self, scale: Requantisation, *, width: int):
        self.scale, self.width = scale, width
        neurons = len(scale.multiplier)
        super().__init__(
            {
                "advance": In(1),
                "i": In(data.ArrayLayout(signed(width), neurons)),
                "o": Out(data.ArrayLayout(unsigned(scale.bits), neurons)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        top = (1 << self.scale.bits) - 1
        for k, multiplier in enumerate(map(int, self.scale.multiplier)):
            a = self.i[k]
            # A register before and after the product, where the DSP slice has them; no reset on data.
            positive = Signal(self.width - 1, reset_less=True, name=f"positive_{k}")
            product = Signal(self.width - 1 + multiplier.bit_length(), reset_less=True, name=f"product_{k}")
            activation = Signal(self.scale.bits, reset_less=True, name=f"activation_{k}")
            scaled = product[self.scale.shift :]
            with m.If(self.advance):
                m.d.sync += [
                    positive.eq(Mux(a < 0, 0, a)),
                    product.eq(positive * multiplier),
                    activation.eq(Mux(scaled > top, top, scaled)),
                ]
            m.d.comb += self.o[k].eq(activation)
        return m


class Requantise(wiring.Component):
    """Requantise one accumulator of every neuron a clock.

    Members
    -------
    i : stream of `len(scale.multiplier)` accumulators, signed(width)
    o : stream of as many activations, unsigned(scale.bits)

    `latency` clocks pass from an accepted vector to its activations if nothing stalls.
    """

    latency = RequantiseCore.latency

    def __init__(self, scale: Requantisation, *, width: int):
        self.scale, self.width = scale, width
        neurons = len(scale.multiplier)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(width), neurons))),
                "o": Out(stream.Signature(data.ArrayLayout(unsigned(scale.bits), neurons))),
            }
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.core = core = RequantiseCore(self.scale, width=self.width)

        # The core never stalls by itself; it moves whenever its last register may move.
        valid = Signal(self.latency)
        m.d.comb += [
            core.advance.eq(self.o.ready | ~self.o.valid),
            core.i.eq(self.i.payload),
            self.i.ready.eq(core.advance),
            self.o.payload.eq(core.o),
            self.o.valid.eq(valid[-1]),
        ]
        with m.If(core.advance):
            m.d.sync += valid.eq(Cat(self.i.valid, valid))
        return m
