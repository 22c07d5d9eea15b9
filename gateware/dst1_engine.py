# amaranth: UnusedElaboratable=no
"""Orthonormal DST-I of the rows of a frame, with the products halved by the sine's symmetry."""

import numpy as np
from amaranth import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.arithmetic.product_cascade import cascade_latency, product_cascade
from fastac.gateware.stream.queues import CreditQueue
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.words import signed_width

CASCADE = 4
"""Products that are added in their DSP slices, one after the other: two levels of an adder tree. With more,
the products' operands would need more registers outside the slices, and a transform more clocks."""


class Dst1Engine(wiring.Component):
    """Transform rows of N = `transform.size` values, `lanes` values per clock, bit-exact to `transform`.

    Even and odd symmetry halve the products: with u_n = x_n + x_{N+1−n} for odd k and v_n = x_n − x_{N+1−n}
    for even k (n, k from 1), each output is a sum of `half` = ceil(N/2) products. Each lane has `half`
    products, in cascades of `CASCADE`, and an adder tree over the cascades' sums; it completes one output per
    clock, so outputs leave in natural order. A product takes one DSP48E2 if input_width <= 26 and
    coefficient_width <= 18, one DSP48E1 if input_width <= 24, and else two. A slice adds sums of up to 48
    bits.

    Members
    -------
    i : stream of `lanes` values, signed(transform.input_width)
    o : stream of `lanes` transformed values, signed(transform.output_width)

    A row is `interval` = ceil(N/lanes) beats in natural order; the lanes beyond N in its last beat are
    ignored. While one row is transformed the next is collected: initiation interval `interval` clocks a row.
    `latency` = 7 + ceil(log2(half/4)) clocks from the accepted last beat of a row to its first output beat,
    without back-pressure; the other beats follow in the next clocks. With back-pressure, beats collect in
    the output queue, and none starts without a free place there (CreditQueue). `i.ready` comes from
    registers.
    """

    def __init__(self, transform: SineTransform, *, lanes: int, dsp: DspSlice = DSP48E2):
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        if transform.size <= lanes:
            raise ValueError(f"matrix of size {transform.size}: expected more than lanes = {lanes}")
        parity = 1 - 2 * (np.arange(transform.size)[:, None] % 2)
        if not np.array_equal(transform.matrix, parity * transform.matrix[:, ::-1]):
            raise ValueError("matrix: expected rows even and odd about the middle in turn, as a sine's are")
        self.transform, self.lanes, self.dsp = transform, lanes, dsp
        self.half = self.half_of(transform.size)
        self.interval = -(-transform.size // lanes)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(transform.input_width), lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(transform.output_width), lanes))),
            }
        )

    @staticmethod
    def half_of(size: int) -> int:
        """Products per output for rows of `size` values."""
        return (size + 1) // 2

    @classmethod
    def levels_of(cls, size: int) -> int:
        """Levels of the adder tree over the sums of the cascades."""
        return (-(-cls.half_of(size) // CASCADE) - 1).bit_length()

    @classmethod
    def latency_of(cls, size: int) -> int:
        """Registers: the row, those of a cascade, and one per level of the adder tree."""
        return 1 + cascade_latency(CASCADE) + cls.levels_of(size)

    @classmethod
    def multipliers_of(
        cls, size: int, lanes: int, *, input_width: int, coefficient_width: int, dsp: DspSlice
    ) -> int:
        """DSP slices: `half_of(size)` products a lane, of sums of two inputs with coefficients."""
        return cls.half_of(size) * lanes * dsp.slices(input_width + 1, coefficient_width)

    @property
    def levels(self) -> int:
        return self.levels_of(self.transform.size)

    @property
    def latency(self) -> int:
        return self.latency_of(self.transform.size)

    @property
    def multipliers(self) -> int:
        return self.multipliers_of(
            self.transform.size,
            self.lanes,
            input_width=self.transform.input_width,
            coefficient_width=self.transform.coefficient_width,
            dsp=self.dsp,
        )

    def elaborate(self, platform):
        m = Module()
        size, last = self.transform.size, self.interval - 1
        word = signed(self.transform.input_width)

        # Collect a row; its last beat goes directly to the operand registers when they are free. Whether a
        # beat or step is the last is registered: the enables' fan-out leaves no time for a comparator.
        beat = Signal(range(self.interval))
        last_beat = Signal()
        collected = Signal(data.ArrayLayout(word, last * self.lanes), reset_less=True)
        operands = Signal(data.ArrayLayout(word, size), reset_less=True)
        row = Cat(collected, self.i.payload)
        accept, load, free = Signal(), Signal(), Signal()
        m.d.comb += [
            self.i.ready.eq(~last_beat | free),
            accept.eq(self.i.valid & self.i.ready),
            load.eq(self.i.valid & last_beat & free),
        ]
        with m.If(accept):
            m.d.sync += [
                beat.eq(Mux(last_beat, 0, beat + 1)),
                last_beat.eq(beat == last - 1),
                collected.eq(row[self.lanes * word.width :]),
            ]
        with m.If(load):
            m.d.sync += operands.eq(row[: size * word.width])

        # One step per output beat; the pipeline after it has no clock enable.
        active = Signal()
        step = Signal(range(self.interval))
        following = Signal(range(self.interval))
        has_word = Signal()
        last_step = Signal()
        launch = Signal()
        valid = Signal(self.latency - 1)
        payload = self.o.payload.shape()
        m.submodules.queue = queue = CreditQueue(payload, depth=CreditQueue.depth_of(len(valid)))
        m.d.comb += [
            launch.eq(active & queue.room),
            free.eq(~active | (queue.room & last_step)),
            queue.launch.eq(launch),
            queue.i_valid.eq(valid[-1]),
        ]
        m.d.sync += valid.eq(Cat(launch, valid))
        read = launch | ~has_word
        m.d.sync += has_word.eq(1)
        with m.If(read):
            m.d.sync += [
                step.eq(following),
                following.eq(Mux(following == last, 0, following + 1)),
                last_step.eq(following == last),
            ]
        with m.If(free):
            m.d.sync += active.eq(load)
        wiring.connect(m, queue.o, wiring.flipped(self.o))

        # The table's read register has the coefficients of the next step to launch from the first clock after
        # a reset on, so that they reach the multipliers together with the folded operands, which have no
        # register before the multipliers'. Its address comes from a register.
        constant = signed(self.transform.coefficient_width)
        m.submodules.table = table = memory.Memory(
            shape=data.ArrayLayout(data.ArrayLayout(constant, self.half), self.lanes),
            depth=self.interval,
            init=self._table(),
            attrs={"rom_style": "block"},
        )
        words = table.read_port()
        m.d.comb += [words.addr.eq(following), words.en.eq(read)]

        # One lane alternates between odd and even k; with several, each lane always has the same parity.
        kinds = [step[0]] if self.lanes == 1 else [Const(0, 1), Const(1, 1)]
        halves = [self._fold(m, operands, even, kind) for kind, even in enumerate(kinds)]
        for lane in range(self.lanes):
            coefficients = [words.data[lane][n] for n in range(self.half)]
            pairs = list(zip(halves[lane % len(halves)], coefficients, strict=True))
            total = self._rounded_sum(m, platform, pairs, name=f"product_{lane}")
            m.d.comb += queue.i[lane].eq(total >> self.transform.shift)
        return m

    def _table(self) -> list:
        """The first `half` coefficients of every output, as (beats, lanes, half)."""
        table = np.zeros((self.interval * self.lanes, self.half), dtype=int)
        table[: self.transform.size] = self.transform.matrix[:, : self.half]
        return table.reshape(self.interval, self.lanes, self.half).tolist()

    def _fold(self, m, operands, even, kind: int) -> list:
        """The sums x_n + x_{N+1−n}, or x_n − x_{N+1−n} if `even`; the middle x has no partner."""
        folded = []
        for n in range(self.half):
            mirror = self.transform.size - 1 - n
            x, y = operands[n], operands[mirror] if mirror != n else Const(0)
            both = Signal(signed(self.transform.input_width + 1), name=f"folded_{kind}_{n}")
            m.d.comb += both.eq(Mux(even, x - y, x + y))
            folded.append(both)
        return folded

    def _bound(self, end: int, first: int = 0) -> int:
        """The largest magnitude of the sum of the products `first` to `end` - 1 of any output.

        The first sum has the rounding constant, too.
        """
        largest = int(np.abs(self.transform.matrix[:, first:end]).sum(axis=1).max())
        return (largest << self.transform.input_width) + (0 if first else self.transform.half_unit)

    def _rounded_sum(self, m, platform, pairs, *, name: str):
        """Sum of the products of `pairs` and the rounding constant: cascades, and an adder tree over them."""
        sums, span = [], CASCADE
        for first in range(0, self.half, span):
            own = pairs[first : first + span]
            total = product_cascade(
                m,
                platform,
                Const(1),
                own,
                [self._bound(first + k + 1, first) for k in range(len(own))],
                start=0 if first else self.transform.half_unit,
                wait=span - len(own),
                name=f"{name}_{first}",
            )
            sums.append(total)
        for _ in range(self.levels):
            span *= 2
            totals = []
            for k in range(0, len(sums), 2):
                first = k // 2 * span
                width = signed_width(self._bound(min(first + span, self.half), first))
                total = Signal(signed(width), reset_less=True)
                m.d.sync += total.eq(sum(sums[k + 1 : k + 2], sums[k]))
                totals.append(total)
            sums = totals
        return sums[0]
