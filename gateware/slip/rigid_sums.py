"""Sums over the dots in contact, from which the rigid motion that fits their shifts follows."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.product import LATENCY, product
from fastac.gateware.dots.follower import dot_layout
from fastac.gateware.stream.tables import RecordTable
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_spread import DotSpread
from fastac.models.integer.words import signed_width

KEPT_FRAMES = 4
"""Frames whose dots are kept until it is known which are in contact; the solvers hold fewer."""
SIGNED = ("u", "v", "x", "y", "turn")
"""Sums that may be negative; n, square and far are not."""


def sums_layout(spread: DotSpread) -> data.StructLayout:
    """n, Σu, Σv, Σx, Σy, Σ(u² + v²), Σ(x v − y u) and Σ(x² + y²) over the dots in contact."""
    bounds = spread.bounds
    shapes = {name: unsigned(bounds[name].bit_length()) for name in ("n", "square", "far")}
    return data.StructLayout(shapes | {name: signed(signed_width(bounds[name])) for name in SIGNED})


class RigidSums(wiring.Component):
    """Keep the dots of each frame until it is known which are in contact, then add those up.

    Members
    -------
    dots : stream of one dot per beat, see `dot_layout`, M of them a frame in the order of `follower.rest`
    contact : stream of one beat per frame, see `DotContact.o`
    o : stream of one beat per frame, see `sums_layout`
    write : write port of the dots' indices and places, see `table`; must not be used while a frame is in
        flight. Only if `loadable`.

    The dots of KEPT_FRAMES frames are kept, so that `dots` has not to wait. `latency`
    = M + 5 clocks from a frame's contact to its sums, and one more from its last dot: memory, products and
    sums. Initiation interval: `latency` + 1, if the sums are taken at once.
    """

    multipliers = 4
    """DSP slices of either kind: shifts and places have at most 15 bits in images of 256 pixels."""

    def __init__(self, spread: DotSpread, follower: DotFollower, order: np.ndarray):
        self.spread, self.follower, self.order = spread, follower, order
        self.loadable = spread.side is not None
        self.table = RecordTable(*self._records())
        members = {
            "dots": In(stream.Signature(dot_layout(follower))),
            "contact": In(stream.Signature(len(order))),
            "o": Out(stream.Signature(sums_layout(spread))),
        }
        if self.loadable:
            members["write"] = In(self.table.format.signature)
        super().__init__(members)

    def _records(self) -> tuple[data.StructLayout, list[dict]]:
        """The layout of what is known of a dot in `order`, and that of each."""
        xy = self.spread.xy[self.order]
        x_largest, y_largest, far_largest = self.spread.largest
        layout = data.StructLayout(
            {
                "dot": unsigned(max(1, (len(self.order) - 1).bit_length())),
                "x": signed(signed_width(x_largest)),
                "y": signed(signed_width(y_largest)),
                "far": unsigned(max(1, far_largest.bit_length())),
            }
        )
        rows = zip(self.order.tolist(), *xy.T.tolist(), (xy**2).sum(axis=1).tolist(), strict=True)
        return layout, [dict(zip(layout.members, row, strict=True)) for row in rows]

    @staticmethod
    def latency_of(count: int) -> int:
        return count + LATENCY + 2

    @property
    def latency(self) -> int:
        return self.latency_of(len(self.order))

    @property
    def interval(self) -> int:
        return self.latency + 1

    def elaborate(self, platform):
        m = Module()
        count = len(self.order)
        bank_bits = (KEPT_FRAMES - 1).bit_length()
        m.submodules.kept = kept = memory.Memory(
            shape=dot_layout(self.follower),
            depth=1 << (bank_bits + (count - 1).bit_length()),
            init=[],
            attrs={"ram_style": "block"},
        )
        write, read = kept.write_port(), kept.read_port()
        whole = Signal(range(KEPT_FRAMES + 1))  # frames whose dots are all kept, and not all read
        room = Signal()
        come = Signal(range(count))
        into = Signal(bank_bits)
        out_of = Signal(bank_bits)
        stored, begun, done = Signal(), Signal(), Signal()
        m.d.comb += [
            room.eq(whole != KEPT_FRAMES),
            self.dots.ready.eq(room),
            write.addr.eq(Cat(come, into)),
            write.data.eq(self.dots.payload),
            write.en.eq(self.dots.valid & room),
            stored.eq(write.en & (come == count - 1)),
        ]
        with m.If(write.en):
            m.d.sync += come.eq(Mux(stored, 0, come + 1))
        m.d.sync += [whole.eq(whole + stored - done), into.eq(into + stored), out_of.eq(out_of + done)]

        places = self.table.memory(m, "places", self.write if self.loadable else None)
        table = places.read_port(domain="comb")

        index = Signal(range(count))
        bits = Signal(count)
        walking = Signal()
        last = Signal()
        place, touches = Signal(self.table.layout), Signal()
        flow = Signal(LATENCY + 1)  # the last dot on its way through memory, products and sum
        m.d.comb += [
            table.addr.eq(index),
            read.addr.eq(Cat(table.data.dot[: len(read.addr) - bank_bits], out_of)),
            begun.eq(self.contact.valid & (whole != 0) & ~walking & ~flow.any() & ~self.o.valid),
            self.contact.ready.eq(begun),
            last.eq(walking & (index == count - 1)),
            done.eq(last),
        ]
        with m.If(begun):
            m.d.sync += [walking.eq(1), index.eq(0), bits.eq(self.contact.payload)]
        with m.If(walking):
            m.d.sync += [index.eq(index + 1), bits.eq(bits >> 1)]
        with m.If(last):
            m.d.sync += walking.eq(0)
        m.d.sync += [
            flow.eq(Cat(last, flow)),
            place.eq(table.data),
            touches.eq(bits[0]),
        ]
        counts, dot = Signal(), read.data
        m.d.comb += counts.eq(touches & dot.seen)

        def if_counts(value):
            return Mux(counts, value, 0)

        u, v, x, y = operands = [Signal.like(value) for value in (dot.u, dot.v, place.x, place.y)]
        m.d.comb += [
            signal.eq(if_counts(value))
            for signal, value in zip(operands, (dot.u, dot.v, place.x, place.y), strict=True)
        ]
        uu, vv, xv, yu = (
            product(m, platform, 1, a, b, name=name)
            for name, a, b in (("uu", u, u), ("vv", v, v), ("xv", x, v), ("yu", y, u))
        )
        sums = self.o.payload
        with m.If(begun):
            m.d.sync += sums.as_value().eq(0)
        with m.Else():
            m.d.sync += [
                sums.n.eq(sums.n + counts),
                *(sums[name].eq(sums[name] + value) for name, value in zip("uvxy", operands, strict=True)),
                sums.far.eq(sums.far + if_counts(place.far)),
                sums.square.eq(sums.square + uu + vv),
                sums.turn.eq(sums.turn + xv - yu),
            ]
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.If(flow[-1]):
            m.d.sync += self.o.valid.eq(1)
        return m
