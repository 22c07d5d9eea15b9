"""From a layer's accumulators to the next layer's activations."""

from amaranth import Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from models.integer import Requantisation


class Requantise(wiring.Component):
    """Requantise one accumulator of every neuron a clock.

    Members
    -------
    i : stream of `len(scale.multiplier)` accumulators, signed(width)
    o : stream of as many activations, unsigned(scale.bits)

    `latency` clocks pass from an accepted vector to its activations if nothing stalls.
    """

    latency = 3

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

        # The core never stalls by itself; it moves whenever its last register may move.
        advance = Signal()
        valid = Signal(self.latency)
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            self.i.ready.eq(advance),
            self.o.valid.eq(valid[-1]),
        ]
        with m.If(advance):
            m.d.sync += valid.eq((valid << 1) | self.i.valid)

        top = (1 << self.scale.bits) - 1
        for k, multiplier in enumerate(map(int, self.scale.multiplier)):
            a, q = self.i.payload[k], self.o.payload[k]
            # A register before and after the product, where the DSP slice has them; no reset on data.
            positive = Signal(self.width - 1, reset_less=True, name=f"positive_{k}")
            product = Signal(self.width - 1 + multiplier.bit_length(), reset_less=True, name=f"product_{k}")
            scaled = product >> self.scale.shift
            with m.If(advance):
                m.d.sync += [
                    positive.eq(Mux(a < 0, 0, a)),
                    product.eq(positive * multiplier),
                    q.eq(Mux(scaled > top, top, scaled)),
                ]
        return m
