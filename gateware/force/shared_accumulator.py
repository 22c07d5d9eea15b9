# amaranth: UnusedElaboratable=no
"""The sums of several axes, whose terms come in turn, so that one adder serves all of them."""

from itertools import pairwise

import numpy as np
from amaranth import Array, Module, Mux, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out


class SharedAccumulator(wiring.Component):
    """Sum the terms of each axis, which come axis by axis in turn: axis 0, 1, …, 0, 1, ….

    Parameters: `axes`; `width`, the bits of a sum, which hold every partial sum; `term_width`; `start`
    (axes,), the initial value of each sum.

    Members
    -------
    advance : clock enable of all registers
    term : signed(term_width), with `valid`
    ends : with the last term of the last axis; the next term begins new sums
    sums : signed(width) per axis
    done : `sums` are complete, for one clock with `advance` high
    start : replaces the parameter `start`, signed(width) per axis. Only with `loadable`.

    The sums go round in a ring of registers, the next axis' at its head, so that no multiplexer chooses
    among them. `latency` = 1 clock from the last term to the sums. Initiation interval: 1 clock per term.
    """

    latency = 1

    def __init__(
        self,
        axes: int,
        *,
        width: int,
        term_width: int,
        start: np.ndarray | None = None,
        loadable: bool = False,
    ):
        self.axes, self.width, self.loadable = axes, width, loadable
        self.initial = np.zeros(axes, np.int64) if start is None else start
        sums = data.ArrayLayout(signed(width), axes)
        members = {
            "advance": In(1),
            "term": In(signed(term_width)),
            "valid": In(1),
            "ends": In(1),
            "sums": Out(sums),
            "done": Out(1),
        }
        if loadable:
            members["start"] = In(sums)
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        ring = [Signal(signed(self.width), reset_less=True, name=f"sum_{k}") for k in range(self.axes)]
        fresh = Signal(init=1)  # the next term of each axis is its first
        start = list(self.start) if self.loadable else [int(word) for word in self.initial]
        if self.axes == 1:
            begins, last_axis = start[0], 1
        else:
            axis = Signal(range(self.axes))
            begins, last_axis = Array(start)[axis], axis == self.axes - 1
            with m.If(self.advance & self.valid):
                m.d.sync += axis.eq(Mux(last_axis, 0, axis + 1))
        with m.If(self.advance):
            m.d.sync += self.done.eq(self.valid & self.ends)
            with m.If(self.valid):
                m.d.sync += ring[-1].eq(Mux(fresh, begins, ring[0]) + self.term)
                m.d.sync += [kept.eq(following) for kept, following in pairwise(ring)]
                with m.If(last_axis):
                    m.d.sync += fresh.eq(self.ends)
        m.d.comb += [total.eq(kept) for total, kept in zip(self.sums, ring, strict=True)]
        return m
