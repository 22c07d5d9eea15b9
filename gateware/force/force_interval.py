# amaranth: UnusedElaboratable=no
"""Half the width of the interval around each force, from what is measured in its frame."""

from amaranth import Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic import product
from fastac.gateware.force.shared_accumulator import SharedAccumulator
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.gateware.stream.frame_validity import by_stage
from fastac.gateware.stream.tables import RecordTable
from fastac.models.integer.force_interval import BASE_BITS, LOAD, WEIGHT_BITS, ForceInterval
from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.integer.words import signed_width


class ForceIntervalStream(wiring.Component):
    """Find the half-widths of each frame, bit-exact to `interval.half_widths(measures, forces)`.

    Parameters: the measures of `validity` give the widths of their words; `force_width`, bits of a force.

    Members
    -------
    features_measures, features_measured : measures of a frame, signed of their widths, and a pulse with
        them, once per frame. Only if the interval depends on them, as the next two.
    slopes_measures, slopes_measured : the same for those that are complete with the slopes
    room : a force may be taken; low from one until its half-widths are taken
    force, force_taken : a frame's accumulators, signed(force_width) per axis, and a pulse with them, only
        while `room` is high
    o : stream of one beat per frame: a half-width per axis, unsigned(half_width)
    base : that of the interval, unsigned(BASE_BITS) per axis. Only with `loadable`, as the next one.
    weights : write port of the weights, see `TableFormat`

    Measures wait in queues for FRAMES_IN_FLIGHT frames, more than a datapath holds, so that those of a frame
    may come before the force of earlier ones; or after their own force, which then waits. One multiplier
    finds the products in turn, the load's last.
    `latency` counts from a force to its half-widths, if all measures of its frame have been there for
    `preparation` clocks; a frame takes `interval` clocks.
    """

    multipliers = 1

    def __init__(
        self, interval: ForceInterval, validity: FrameValidity, *, force_width: int, loadable: bool = False
    ):
        self.integers, self.force_width, self.loadable = interval, force_width, loadable
        self.axes = len(interval.base)
        self.groups = by_stage(interval.pixel_measures)
        limits = dict(zip(interval.measures, interval.limits.tolist(), strict=True))
        widths = dict(zip(validity.names, validity.widths, strict=True)) | {LOAD: force_width}
        for name, limit in limits.items():
            if signed_width(limit) < widths[name]:
                raise ValueError(f"limit of {name} {limit}: expected one of {widths[name]} bits")
        members = {"force_taken": In(1), "room": Out(1)}
        for stage, names in self.groups.items():
            layout = data.StructLayout({name: signed(widths[name]) for name in names})
            members |= {f"{stage}_measures": In(layout), f"{stage}_measured": In(1)}
        members["force"] = In(data.ArrayLayout(signed(force_width), self.axes))
        members["o"] = Out(stream.Signature(data.ArrayLayout(unsigned(self.half_width), self.axes)))
        if loadable:
            members["base"] = In(data.ArrayLayout(unsigned(BASE_BITS), self.axes))
            members["weights"] = In(self.table.format.signature)
        super().__init__(members)

    @property
    def order(self) -> list[str]:
        """The measures in the order of their products; the load is there in any case, so that a force is."""
        return [name for names in self.groups.values() for name in names] + [LOAD]

    @property
    def table(self) -> RecordTable:
        """The weights in the order of the products: all axes of the first measure, and so on."""
        known = dict(zip(self.integers.measures, self.integers.weights.T.tolist(), strict=True))
        rows = [{"weight": w} for name in self.order for w in known.get(name, [0] * self.axes)]
        bits = (
            WEIGHT_BITS if self.loadable else max(int(self.integers.weights.max(initial=1)).bit_length(), 1)
        )
        # A table has two words or more; a single product never reads the second.
        return RecordTable(data.StructLayout({"weight": bits}), rows + [{"weight": 0}] * (len(rows) == 1))

    @property
    def base_image(self) -> int:
        """The interval's base as the member `base` has it."""
        return sum(int(word) << (k * BASE_BITS) for k, word in enumerate(self.integers.base))

    @property
    def _sum_bound(self) -> int:
        """The largest sum of any axis, with any weights and base that can be loaded."""
        if not self.loadable:
            return max(self.integers.sum_bounds)
        largest = (1 << WEIGHT_BITS) - 1
        return (1 << BASE_BITS) - 1 + largest * sum(self.integers.magnitude_bounds)

    @property
    def half_width(self) -> int:
        """Bits of a half-width, without a sign."""
        if not self.loadable:
            return self.integers.half_width
        return max(self._sum_bound.bit_length() + int(self.integers.exponent.max()), 1)

    @property
    def products(self) -> dict[str, int]:
        """Products of the measures of pixels, by the stage with which they are complete."""
        return {stage: len(names) * self.axes for stage, names in self.groups.items()}

    @property
    def latency(self) -> int:
        """Magnitude of the load, its products, and the sum of the last of them."""
        return self.latency_of(self.axes)

    @staticmethod
    def latency_of(axes: int) -> int:
        return axes + 1 + product.LATENCY + SharedAccumulator.latency

    @property
    def preparation(self) -> int:
        """Clocks that the products of pixel measures take; those in the queue when a frame begins."""
        return sum(self.products.values())

    @property
    def interval(self) -> int:
        """All products and the sum, which has to be taken before the next frame's products and force."""
        return self.interval_of(self.preparation, self.axes)

    @classmethod
    def interval_of(cls, preparation: int, axes: int) -> int:
        return cls.latency_of(axes) + max(preparation, 1)

    def _magnitude(self, name: str, value) -> Value:
        """|value >> shift|, unsigned, with just the bits that the measure's limit needs."""
        if name not in self.integers.measures:
            return Const(0, 1)
        k = self.integers.measures.index(name)
        shifted = value >> int(self.integers.shifts[k])
        return Mux(shifted < 0, -shifted, shifted)[: self.integers.magnitude_widths[k]]

    def elaborate(self, platform):
        m = Module()
        # Of each measure its magnitude, whether it is there, and what its last product takes from a queue.
        operands, there, takes = [], [], {}
        for stage, names in self.groups.items():
            given = getattr(self, f"{stage}_measures")
            magnitudes = [self._magnitude(name, given[name]) for name in names]
            m.submodules[f"{stage}_queue"] = queue = fifo.SyncFIFO(
                width=sum(len(magnitude) for magnitude in magnitudes), depth=FRAMES_IN_FLIGHT
            )
            m.d.comb += [queue.w_data.eq(Cat(magnitudes)), queue.w_en.eq(getattr(self, f"{stage}_measured"))]
            low = 0
            for magnitude in magnitudes:
                operands.append(queue.r_data[low : low + len(magnitude)])
                there.append(queue.r_rdy)
                low += len(magnitude)
            takes[len(operands) - 1] = queue.r_en
        load_value = self._magnitude(LOAD, self.force[self.integers.load_axis])
        load, load_there = Signal(len(load_value), reset_less=True), Signal()
        operands.append(load)
        there.append(load_there)

        count, busy, stays = len(operands), Signal(), Signal()
        place, axis, step = Signal(range(count)), Signal(range(self.axes)), Signal(range(count * self.axes))
        here, last_axis, ends, moves = Signal(), Signal(), Signal(), Signal()
        operand = Signal(max(len(word) for word in operands), reset_less=True)
        with m.Switch(place):
            for k, (word, known) in enumerate(zip(operands, there, strict=True)):
                with m.Case(k):
                    m.d.comb += here.eq(known)
                    m.d.sync += operand.eq(word)
                    if k in takes:
                        m.d.comb += takes[k].eq(moves & last_axis)
        m.d.comb += [
            moves.eq(here & ~stays),
            last_axis.eq(axis == self.axes - 1),
            ends.eq(last_axis & (place == count - 1)),
            self.room.eq(~busy),
        ]
        with m.If(moves):
            m.d.sync += [step.eq(Mux(ends, 0, step + 1)), axis.eq(Mux(last_axis, 0, axis + 1))]
            with m.If(last_axis):
                m.d.sync += place.eq(Mux(ends, 0, place + 1))
            with m.If(ends):
                m.d.sync += [load_there.eq(0), stays.eq(1)]

        memory = self.table.memory(m, "weight_table", self.weights if self.loadable else None)
        weight = memory.read_port()
        m.d.comb += weight.addr.eq(step)
        term = product.product(m, platform, Const(1), operand, weight.data.weight, name="weighted")
        m.submodules.sums = sums = SharedAccumulator(
            self.axes,
            width=signed_width(self._sum_bound),
            term_width=len(term) + 1,
            start=self.integers.base,
            loadable=self.loadable,
        )
        under_way, last = Signal(1 + product.LATENCY), Signal(1 + product.LATENCY)
        waits = Signal()
        m.d.sync += [under_way.eq(Cat(moves, under_way)), last.eq(Cat(ends, last))]
        m.d.comb += [
            sums.advance.eq(1),
            sums.term.eq(term),
            sums.valid.eq(under_way[-1]),
            sums.ends.eq(last[-1]),
            self.o.valid.eq(sums.done | waits),
        ]
        if self.loadable:
            m.d.comb += [start.eq(word) for start, word in zip(sums.start, self.base, strict=True)]
        for half, total, exponent in zip(
            self.o.payload, sums.sums, self.integers.exponent.tolist(), strict=True
        ):
            m.d.comb += half.eq(total.shift_left(exponent) if exponent >= 0 else total >> -exponent)
        m.d.sync += waits.eq(self.o.valid & ~self.o.ready)
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += [stays.eq(0), busy.eq(0)]
        with m.If(self.force_taken):
            m.d.sync += [load.eq(load_value), load_there.eq(1), busy.eq(1)]
        return m
