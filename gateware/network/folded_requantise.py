# amaranth: UnusedElaboratable=no
"""Requantisation of one neuron after another: a layer's accumulators become the next layer's activations."""

from amaranth import Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.product import product
from fastac.gateware.network.fold_plan import Series
from fastac.gateware.network.folded_parameters import Column, columns_reader, row_counter, write_signature
from fastac.gateware.network.requantise import COARSE, MULTIPLIER_BITS, SHIFT_BITS
from fastac.models.integer.network import Requantisation

LARGEST_SHIFT = 47


class FoldedRequantise(wiring.Component):
    """ReLU, scale and clip: min((max(a, 0) · multiplier) >> shift, 2**bits − 1), without a handshake.

    Members
    -------
    begins : high one clock before the first accumulators of a vector are at `i`; vectors begin at least
        `fold` clocks after each other
    i : the series `neurons` of accumulators, signed(width) each
    o : the series of activations, unsigned(scale.bits) each
    write : write port of `columns`, see `write_signature`. Only if `loadable`.

    One multiplier for each stream. A loadable shift is by a multiple of 8 first and by 0 … 7 then; of what
    the second cannot bring down to the activation's bits, only whether there is any is kept.
    `latency` = 5 clocks, loadable or not: 3 of the product, shift, clip.
    """

    latency = 5

    def __init__(self, scale: Requantisation, *, width: int, fold: int, loadable: bool = False):
        self.scale, self.width, self.fold, self.loadable = scale, width, fold, loadable
        self.neurons = Series(len(scale.multiplier), fold)
        members = {
            "begins": In(1),
            "i": In(data.ArrayLayout(signed(width), self.neurons.streams)),
            "o": Out(data.ArrayLayout(unsigned(scale.bits), self.neurons.streams)),
        }
        if loadable:
            members["write"] = In(write_signature(self.columns, fold))
        super().__init__(members)

    @property
    def multipliers(self) -> int:
        return self.neurons.streams

    @property
    def columns(self) -> list[Column]:
        """For each stream the multipliers of its neurons; then the shift, if it is loadable."""
        streams = self.neurons.streams
        columns = [
            Column(unsigned(MULTIPLIER_BITS), tuple(self.scale.multiplier[k::streams].tolist()))
            for k in range(streams)
        ]
        if self.loadable:
            columns.append(Column(unsigned(SHIFT_BITS), (self.scale.shift,)))
        return columns

    def elaborate(self, platform):
        m = Module()
        bits, streams = self.scale.bits, self.neurons.streams
        read = columns_reader(m, self.columns, self.write if self.loadable else None)
        row = row_counter(m, self.begins, self.fold, "row")
        shift = read(streams, row) if self.loadable else None
        for k, a in enumerate(self.i):
            whole = product(m, platform, Const(1), a, read(k, row), name=f"product_{k}")
            negative, magnitude = whole[-1], whole[:-1]
            kept = Signal(bits + ((1 << COARSE) - 1 if self.loadable else 0), name=f"kept_{k}")
            above = Signal(name=f"above_{k}")
            if self.loadable:
                self._coarse(m, magnitude, shift[COARSE:], kept, above)
            else:
                shifted = magnitude.shift_right(self.scale.shift)
                m.d.comb += [kept.eq(shifted[:bits]), above.eq(shifted[bits:].any())]
            held = Signal.like(kept, reset_less=True, name=f"held_{k}")
            beyond = Signal(reset_less=True, name=f"beyond_{k}")
            activation = Signal(bits, reset_less=True, name=f"activation_{k}")
            found, clips, top = held, beyond, (1 << bits) - 1
            if self.loadable:
                fine = held >> shift[:COARSE]
                found, clips = fine[:bits], beyond | fine[bits:].any()
            m.d.sync += [
                held.eq(Mux(negative, 0, kept)),
                beyond.eq(~negative & above),
                activation.eq(Mux(clips, top, found)),
            ]
            m.d.comb += self.o[k].eq(activation)
        return m

    def _coarse(self, m: Module, magnitude: Value, amount: Value, kept: Signal, above: Signal) -> None:
        """The low bits of `magnitude` shifted right by 8 · `amount`, and whether there are any above them."""
        with m.Switch(amount):
            for step in range((LARGEST_SHIFT >> COARSE) + 1):
                shifted = magnitude.shift_right(step << COARSE)
                with m.Case(step):
                    m.d.comb += [kept.eq(shifted), above.eq(shifted[len(kept) :].any())]
