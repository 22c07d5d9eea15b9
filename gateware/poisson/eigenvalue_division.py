"""Division of the sine coefficients by the eigenvalues of the discrete Laplacian, as a product."""

import numpy as np
from amaranth import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.stream.handshake import check_fold, credit_handshake
from fastac.models.integer.dst2d import MANTISSA_BITS, EigenvalueDivision


class EigenvalueDivider(wiring.Component):
    """Divide frames of N × N sine coefficients by their eigenvalues, bit-exact to `division`.

    The eigenvalues are symmetric, so coefficients may come by rows or by columns. Each reciprocal is a
    mantissa and a shift from a table, so a lane needs one DSP48E2 if input_width <= 27, one DSP48E1 if
    input_width <= 25. Rounding to nearest uses floor(a / 2**s + 1/2) = (floor(a / 2**(s − 1)) + 1) >> 1;
    rounding by floor omits the + 1 but has the same latency.

    Members
    -------
    i : stream of `lanes` coefficients, signed(division.input_width): N rows of ceil(N/lanes) beats
    o : stream of `lanes` quotients, signed(division.output_width), in the same order

    The lanes beyond N in a row's last beat are undefined. `latency` = 5 + ceil(b/2) clocks without
    back-pressure, where b is the number of bits of the largest difference of two shifts; initiation
    interval 1. No register has a clock enable: beats that `o` does not take collect in a queue
    (`credit_handshake`). There is one product a lane at any `fold`, clocks between two beats; with one above
    1, and one lane, the table has each pair of symmetric eigenvalues once.
    """

    def __init__(self, division: EigenvalueDivision, *, lanes: int, fold: int = 1, dsp: DspSlice = DSP48E2):
        check_fold(fold, lanes)
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        self.division, self.lanes, self.fold, self.dsp = division, lanes, fold, dsp
        self.shift_low = int(division.shift.min())
        self.distance = int(division.shift.max() - self.shift_low)
        self.distance_bits = self.distance.bit_length()
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(division.input_width), lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(division.output_width), lanes))),
            }
        )

    @staticmethod
    def latency_of(distance: int) -> int:
        """Registers: table read, operands, product, negation, one per two bits of the shift, rounding.

        distance : largest minus smallest shift
        """
        return 5 + -(-distance.bit_length() // 2)

    @property
    def latency(self) -> int:
        return self.latency_of(self.distance)

    @staticmethod
    def multipliers_of(lanes: int, *, input_width: int, dsp: DspSlice) -> int:
        """DSP slices: a product a lane of a coefficient and a mantissa."""
        return lanes * dsp.slices(input_width, MANTISSA_BITS + 1)

    @property
    def multipliers(self) -> int:
        return self.multipliers_of(self.lanes, input_width=self.division.input_width, dsp=self.dsp)

    def elaborate(self, platform):
        m = Module()
        last, ago = credit_handshake(m, self.i, self.o, self.latency)

        # A word of the table has each lane's mantissa and its shift minus the smallest shift.
        entries = self._table()
        entry = data.StructLayout({"mantissa": 17, "distance": self.distance_bits})
        m.submodules.table = table = memory.Memory(
            shape=data.ArrayLayout(entry, self.lanes), depth=len(entries), init=entries
        )
        words = table.read_port()
        beat = Signal(range(len(entries)))
        m.d.comb += words.addr.eq(beat)
        with m.If(ago[0]):
            if self.fold > 1:
                self._step_in_triangle(m, beat)
            else:
                m.d.sync += beat.eq(Mux(beat == len(entries) - 1, 0, beat + 1))

        for lane in range(self.lanes):

            def register(value, name, lane=lane):
                held = Signal(value.shape(), reset_less=True, name=f"{name}_{lane}")
                m.d.sync += held.eq(value)
                return held

            word = words.data[lane]
            coefficient = register(register(self.i.payload[lane], "coefficient"), "operand")
            mantissa = register(word.mantissa, "mantissa")
            product = register(coefficient * mantissa, "product")
            negative = register((-product)[: len(product)].as_signed(), "negative")
            distance = register(register(register(word.distance, "distance"), "distance_m"), "distance_p")

            scaled = negative >> (self.shift_low - 1)
            for bit in range(0, self.distance_bits, 2):
                part = Cat(Const(0, bit), distance[bit : bit + 2])
                scaled = register(scaled >> part, f"scaled_{bit}")
                distance = register(distance, f"distance_{bit}")
            rounded = Signal(signed(self.division.output_width), reset_less=True, name=f"rounded_{lane}")
            m.d.sync += rounded.eq((scaled + self.division.half_bit) >> 1)
            m.d.comb += last.payload[lane].eq(rounded)
        return m

    def _step_in_triangle(self, m, address) -> None:
        """Go from (row, column) to the next one: the greater of both, n, and the lesser, k, are at
        n(n + 1)/2 + k."""
        size = len(self.division.mantissa)
        row = Signal(range(size))
        column = Signal(range(size))
        start = Signal.like(address)  # of the row
        m.d.sync += [column.eq(column + 1), address.eq(address + Mux(column < row, 0, column) + 1)]
        with m.If(column == size - 1):
            m.d.sync += [
                column.eq(0),
                row.eq(row + 1),
                start.eq(start + row + 1),
                address.eq(start + row + 1),
            ]
            with m.If(row == size - 1):
                m.d.sync += [row.eq(0), start.eq(0), address.eq(0)]

    def _table(self) -> list:
        """The table's initial content, in beat order or, folded, row after row up to the diagonal."""
        size = len(self.division.mantissa)
        if self.fold > 1:
            lower = np.tril_indices(size)
            mantissa = self.division.mantissa[lower].tolist()
            distance = (self.division.shift[lower] - self.shift_low).tolist()
            return [[{"mantissa": a, "distance": d}] for a, d in zip(mantissa, distance, strict=True)]
        void = ((0, 0), (0, -size % self.lanes))
        columns = (self.division.mantissa, self.division.shift - self.shift_low)
        mantissa, distance = (np.pad(c, void).reshape(-1, self.lanes).tolist() for c in columns)
        return [
            [{"mantissa": a, "distance": d} for a, d in zip(*beat, strict=True)]
            for beat in zip(mantissa, distance, strict=True)
        ]
