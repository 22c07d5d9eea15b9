"""Orthonormal DST-I of the rows of a frame with multipliers that are shared over the clocks of a value."""

import numpy as np
from amaranth import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.arithmetic.product import product
from fastac.gateware.dst1_engine import Dst1Engine
from fastac.gateware.stream.handshake import check_folded
from fastac.gateware.stream.queues import CreditQueue
from fastac.models.integer.sine_transform import SineTransform


class FoldedDst1(wiring.Component):
    """Transform rows of N = `transform.size` values, one value every `fold` clocks, bit-exact to `transform`.

    As in `Dst1Engine`, output k (from 1) is a sum of `half` = ceil(N/2) products: of x_n + x_{N+1−n} for odd
    k and of x_n − x_{N+1−n} for even k. `products` = ceil(half/fold) multipliers take `fold` clocks for it,
    number j in step t the pair n = t·products + j + 1. They stand in a chain, each a clock later than the one
    before and adding its product to that one's, as DSP slices do without look-up tables. The coefficient is
    a sine at k·n, which a modular counter follows; a table holds one period of it.

    Members
    -------
    i : stream of one value, signed(transform.input_width), a row of N values in natural order
    o : stream of one transformed value, signed(transform.output_width)

    The sums and differences of a row are stored as its second half comes, in two clocks a value, and there
    are two pages: while one row is transformed the next is collected. Initiation interval: `interval` =
    fold · N clocks a row. `latency` = fold + products + 6 clocks from the accepted last value of a row to its
    first output, without back-pressure; the others follow every `fold` clocks. With back-pressure, none
    starts without a free place in the output queue (CreditQueue). `i.ready` comes from registers.
    """

    def __init__(self, transform: SineTransform, *, fold: int, dsp: DspSlice = DSP48E2):
        check_folded(fold)
        if transform.size < 2:
            raise ValueError(f"matrix of size {transform.size}: expected at least 2")
        self.transform, self.fold, self.dsp = transform, fold, dsp
        self.half = Dst1Engine.half_of(transform.size)
        self.products = self.products_of(transform.size, fold)
        self.interval = fold * transform.size
        k = np.arange(1, transform.size + 1)
        if not np.array_equal(self._sine(np.outer(k, k)), transform.matrix):
            raise ValueError("matrix: expected multiples of the sine at k * n, rounded")
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(transform.input_width), 1))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(transform.output_width), 1))),
            }
        )

    @staticmethod
    def products_of(size: int, fold: int) -> int:
        """Products per clock for rows of `size` values."""
        return -(-Dst1Engine.half_of(size) // fold)

    @classmethod
    def latency_of(cls, size: int, fold: int) -> int:
        """Clocks: operand, sum, difference; memory and three registers of a product; the chain and sum."""
        return 6 + cls.products_of(size, fold) + fold

    @classmethod
    def multipliers_of(
        cls, size: int, fold: int, *, input_width: int, coefficient_width: int, dsp: DspSlice
    ) -> int:
        """DSP slices: `products_of(size, fold)` products of sums of two inputs with coefficients."""
        return cls.products_of(size, fold) * dsp.slices(input_width + 1, coefficient_width)

    @property
    def latency(self) -> int:
        return self.latency_of(self.transform.size, self.fold)

    @property
    def multipliers(self) -> int:
        return self.multipliers_of(
            self.transform.size,
            self.fold,
            input_width=self.transform.input_width,
            coefficient_width=self.transform.coefficient_width,
            dsp=self.dsp,
        )

    def _sine(self, index: np.ndarray) -> np.ndarray:
        """The coefficient at each integer multiple of π/(N + 1), from the first row of the matrix."""
        period = self.transform.size + 1
        wave = np.concatenate([[0], self.transform.matrix[0]])
        return np.where(index // period % 2, -1, 1) * wave[index % period]

    def elaborate(self, platform):
        m = Module()
        self._word = signed(self.transform.input_width + 1)
        stores = [memory.Memory(shape=self._word, depth=4 * self.fold, init=[]) for _ in range(self.products)]
        for lane, store in enumerate(stores):
            m.submodules[f"store_{lane}"] = store
        full = Signal(2)
        filled = Signal(2)
        emptied = Signal(2)
        m.d.sync += full.eq((full | filled) & ~emptied)
        self._collect(m, stores, full, filled)
        self._transform(m, platform, stores, full, emptied)
        return m

    def _collect(self, m, stores, full, filled) -> None:
        """Keep the first half of a row; from each value of the second, store a sum and a difference."""
        front, last_step = self.transform.size // 2, (self.half - 1) // self.products
        # The middle one of an odd number of values has no partner: its place here is never written.
        m.submodules.kept = kept = memory.Memory(
            shape=signed(self.transform.input_width), depth=self.half, init=[]
        )
        write, read = kept.write_port(), kept.read_port()
        pair = Signal(range(self.half))
        back = Signal()
        page = Signal(name="fill_page")
        lane = Signal(range(self.products), init=(self.half - 1) % self.products)
        step = Signal(range(self.fold), init=last_step, name="fill_step")
        accept = Signal()
        sums = Signal()
        differences = Signal()
        m.d.comb += [
            self.i.ready.eq(~sums & (~back | ~Mux(page, full[1], full[0]))),
            accept.eq(self.i.valid & self.i.ready),
            write.addr.eq(pair),
            write.data.eq(self.i.payload[0]),
            write.en.eq(accept & ~back),
            read.addr.eq(pair),
            read.en.eq(accept),
        ]
        value = Signal(self.i.payload[0].shape(), reset_less=True)
        place = Signal(data.StructLayout({"step": step.shape(), "page": 1}), reset_less=True)
        chosen = Signal(self.products, reset_less=True)
        last = Signal()
        m.d.sync += [sums.eq(accept & back), differences.eq(sums)]
        with m.If(accept):
            m.d.sync += [value.eq(self.i.payload[0]), place.step.eq(step), place.page.eq(page)]
            m.d.sync += [chosen.eq(1 << lane), last.eq(back & (pair == 0))]
            with m.If(~back):
                m.d.sync += pair.eq(pair + 1)
                with m.If(pair == front - 1):
                    m.d.sync += [back.eq(1), pair.eq(self.half - 1)]
            with m.Else():
                m.d.sync += [pair.eq(pair - 1), lane.eq(lane - 1)]
                with m.If(lane == 0):
                    m.d.sync += [lane.eq(self.products - 1), step.eq(step - 1)]
                with m.If(pair == 0):
                    m.d.sync += [back.eq(0), pair.eq(0), page.eq(~page)]
                    m.d.sync += [lane.eq(lane.init), step.eq(last_step)]
        with m.If(differences & last):
            m.d.comb += filled.eq(Mux(place.page, 2, 1))

        # x − y = x + ~y + 1, the 1 as the carry out of one more bit below, so that one adder is enough.
        word = Signal(self._word)
        other = value.as_unsigned() ^ differences.replicate(len(value))
        added = Cat(differences, read.data).as_signed() + Cat(differences, other).as_signed()
        m.d.comb += word.eq(added >> 1)
        for index, store in enumerate(stores):
            port = store.write_port()
            m.d.comb += [
                port.addr.eq(Cat(place.step, differences, place.page)),
                port.data.eq(word),
                port.en.eq(chosen[index] & (sums | differences)),
            ]

    def _transform(self, m, platform, stores, full, emptied) -> None:
        """One output every `fold` clocks from the page that is full."""
        size, half_unit = self.transform.size, self.transform.half_unit
        under_way = self.products + self.fold + 3
        m.submodules.queue = queue = CreditQueue(self.o.payload.shape(), depth=under_way // self.fold + 1)
        wiring.connect(m, queue.o, wiring.flipped(self.o))

        # The first multiplier's place, and the multiples of the angle that it and its neighbours go on by.
        angle = data.StructLayout({"index": range(size + 1), "negative": 1})
        one, many = ({"index": n, "negative": 0} for n in (1, self.products))
        step = Signal(range(self.fold))
        k = Signal(range(size + 1), init=1)
        page = Signal(name="read_page")
        at = Signal(angle, init=one)
        stride = Signal(angle, init=many)
        launch = Signal()
        going = Signal()
        ends = Signal()
        m.d.comb += [
            launch.eq((step == 0) & queue.room & Mux(page, full[1], full[0])),
            queue.launch.eq(launch),
            going.eq(launch | (step != 0)),
            ends.eq((step == self.fold - 1) & (k == size)),
        ]
        with m.If(going):
            m.d.sync += [step.eq(step + 1), at.eq(self._turned(m, "next", at, stride))]
            with m.If(step == self.fold - 1):
                m.d.sync += [k.eq(k + 1), at.index.eq(k + 1), at.negative.eq(0)]
                m.d.sync += stride.eq(self._turned(m, "next_stride", stride, angle.const(many)))
                with m.If(k == size):
                    m.d.sync += [k.eq(1), at.eq(angle.const(one)), stride.eq(angle.const(many))]
                    m.d.sync += page.eq(~page)

        # A page is free when the last multiplier, products − 1 clocks after the first, has read it.
        read = Signal(data.StructLayout({"step": step.shape(), "even": 1, "page": 1}))
        m.d.comb += [read.step.eq(step), read.even.eq(~k[0]), read.page.eq(page)]
        sines = self._tables(m, 1 << len(at.index))
        total = Const(0)
        for lane, store in enumerate(stores):
            if lane:
                turned = self._turned(m, f"turned_{lane}", at, angle(Cat(k, Const(0, 1))))
                at = self._later(m, f"angle_{lane}", turned)
                k, read = self._later(m, f"k_{lane}", k), self._later(m, f"read_{lane}", read)
                ended, ends = ends, Signal(name=f"ends_{lane}")
                m.d.sync += ends.eq(ended)
            total = self._product(m, platform, lane, store, sines[lane // 2], read, at, total)
        with m.If(ends):
            m.d.comb += emptied.eq(Mux(read.page, 2, 1))

        # The flag of an output's first products reaches the sum with them, the one of its last queues it.
        flags = Signal(under_way)
        m.d.sync += flags.eq(Cat(launch, flags))
        accumulated = Signal(signed(self.transform.accumulator_width), reset_less=True)
        first = flags[self.products + 2]
        m.d.sync += accumulated.eq(total + Mux(first, half_unit, accumulated))
        m.d.comb += [queue.i_valid.eq(flags[-1]), queue.i[0].eq(accumulated >> self.transform.shift)]

    @staticmethod
    def _later(m, name: str, value):
        """A register of `value`, without a reset."""
        held = Signal(value.shape(), name=name, reset_less=True)
        m.d.sync += held.eq(value)
        return held

    def _turned(self, m, name: str, at, by):
        """The angle `at` turned by `by`, in multiples of π/(N + 1): index modulo N + 1, and sign."""
        period = self.transform.size + 1
        total = Signal(range(2 * period), name=f"{name}_total")
        result = Signal(at.shape(), name=name)
        wraps = total >= period
        m.d.comb += [
            total.eq(at.index + by.index),
            result.index.eq(Mux(wraps, total - period, total)),
            result.negative.eq(at.negative ^ by.negative ^ wraps),
        ]
        return result

    def _tables(self, m, places: int) -> list:
        """A period of the sine for each two multipliers, by index and sign: a block RAM has two ports."""
        wave = self._sine(np.arange(self.transform.size + 1)).tolist()
        wave += [0] * (places - len(wave))
        found = []
        for table in range((self.products + 1) // 2):
            m.submodules[f"sines_{table}"] = sines = memory.Memory(
                shape=signed(self.transform.coefficient_width),
                depth=2 * places,
                init=wave + [-c for c in wave],
                attrs={"rom_style": "block"},
            )
            found.append(sines)
        return found

    def _product(self, m, platform, lane: int, store, sines, read, at, total):
        """The sum of `total` and the product of a stored word and the sine of its angle, 4 clocks later."""
        word, sine = store.read_port(), sines.read_port()
        m.d.comb += [word.addr.eq(read), sine.addr.eq(at)]
        if hasattr(platform, "product"):
            done = product(m, platform, Const(1), word.data, sine.data, name=f"product_{lane}")
            return done + (self._later(m, f"chained_{lane}", total) if lane else 0)
        operand = self._later(m, f"operand_{lane}", word.data)
        coefficient = self._later(m, f"coefficient_{lane}", sine.data)
        multiplied = self._later(m, f"multiplied_{lane}", operand * coefficient)
        width = min((multiplied + total).shape().width, self.transform.accumulator_width)
        return self._later(m, f"chained_{lane}", (multiplied + total)[:width].as_signed())
