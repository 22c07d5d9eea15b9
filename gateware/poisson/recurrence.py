"""The tridiagonal solver's recurrences over the rows: forward elimination, back substitution."""

from amaranth import Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.stream.handshake import check_fold, pipeline_handshake
from fastac.models.integer.tridiagonal import COEFFICIENT_BITS, Recurrence


class RowRecurrence(wiring.Component):
    """Evaluate `recurrence`, an Elimination or Substitution, on frames of N × N values, bit-exact to it.

    Columns are the modes of the sine transform. Each value needs the result for the same mode in the previous
    row, which a memory of one row holds. A lane has one product: pre-adder (elimination), product, and a sum
    that includes the rounding constant, one DSP48E2 for words of up to 26 bits, one DSP48E1 for words of up
    to 24. Each lane has a table of its modes' coefficients, mode after mode; of each mode only the rows up to
    the one from which on the coefficient is constant. The address is start[mode] + min(row, last[mode]).

    Members
    -------
    i : stream of `lanes` values, signed(recurrence.input_width): N rows of `beats` = ceil(N/lanes) beats,
        first row first for an elimination, last row first for a substitution
    o : stream of `lanes` values, signed(recurrence.output_width), in the same order

    The lanes beyond N in a row's last beat are undefined. `latency` = 6 clocks without back-pressure;
    initiation interval 1 clock per beat. The recurrence loop takes `loop` = 5 clocks, from reading the
    previous row's value to the result's being readable, so a row must have at least 5 beats. A larger `fold`,
    clocks between two beats, changes nothing: there is one product a lane.
    """

    latency = 6
    loop = 5

    def __init__(self, recurrence: Recurrence, *, lanes: int, fold: int = 1, dsp: DspSlice = DSP48E2):
        check_fold(fold, lanes)
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        if not isinstance(recurrence, Recurrence):
            raise ValueError(f"recurrence {type(recurrence).__name__}: expected Elimination or Substitution")
        self.recurrence, self.lanes, self.dsp = recurrence, lanes, dsp
        self.downwards = recurrence.downwards
        self.beats = -(-recurrence.size // lanes)
        if self.beats < self.loop:
            raise ValueError(
                f"rows of {recurrence.size} values, {self.beats} beats: expected at least {self.loop} beats,"
                " the latency of the recurrence loop in clocks"
            )
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(recurrence.input_width), lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(recurrence.output_width), lanes))),
            }
        )

    @staticmethod
    def multipliers_of(lanes: int, *, width: int, downwards: bool, dsp: DspSlice) -> int:
        """DSP slices: a product a lane with words of `width` bits, of differences of two on the way down."""
        return lanes * dsp.slices(width + downwards, COEFFICIENT_BITS + 1)

    @property
    def multipliers(self) -> int:
        recurrence = self.recurrence
        width = recurrence.output_width
        if self.downwards:
            width = max(recurrence.input_width, width)
        return self.multipliers_of(self.lanes, width=width, downwards=self.downwards, dsp=self.dsp)

    def tables(self) -> tuple[list[list[dict[str, int]]], list[list[int]]]:
        """For each lane: {start, last} of the mode in each beat, and the coefficients, mode after mode."""
        places, words = [], []
        for lane in range(self.lanes):
            starts, found = [], []
            for mode in range(lane, self.beats * self.lanes, self.lanes):
                void = mode >= self.recurrence.size
                last = 0 if void else int(self.recurrence.varying[mode])
                starts.append({"start": len(found), "last": last})
                found += [0] if void else self.recurrence.coefficient[: last + 1, mode].tolist()
            places.append(starts)
            words.append(found)
        return places, words

    def elaborate(self, platform):
        m = Module()
        size, last_row = self.recurrence.size, self.recurrence.size - 1
        advance = pipeline_handshake(m, self.i, self.o, self.latency)

        def register(value, name, steps=1):
            """`value` delayed by `steps` registers without a reset."""
            for step in range(steps):
                held = Signal(value.shape(), reset_less=True, name=f"{name}_{step}" if steps > 1 else name)
                with m.If(advance):
                    m.d.sync += held.eq(value)
                value = held
            return value

        # Stage 1: position in the coefficient tables; `row` counts as the coefficients' rows do.
        first_row = 0 if self.downwards else last_row
        row, beat = Signal(range(size), init=first_row), Signal(range(self.beats))
        with m.If(advance & self.i.valid):
            m.d.sync += beat.eq(beat + 1)
            with m.If(beat == self.beats - 1):
                m.d.sync += [beat.eq(0), row.eq(row + 1 if self.downwards else row - 1)]
                with m.If(row == last_row - first_row):
                    m.d.sync += row.eq(first_row)
        row_1 = register(row, "row")
        words = register(self.i.payload, "words", 3)
        first = register(row == first_row, "first", 3)

        # Stage 2: address. Stage 3: coefficients, and the previous row's results, stored when they leave `o`.
        beat_2 = register(beat, "beat_early", 2)
        m.submodules.before = before = memory.Memory(shape=self.o.payload.shape(), depth=self.beats, init=[])
        read, write = before.read_port(), before.write_port()
        m.d.comb += [
            read.addr.eq(beat_2),
            read.en.eq(advance),
            write.addr.eq(register(beat_2, "beat_late", self.latency - 2)),
            write.data.eq(self.o.payload),
            write.en.eq(advance & self.o.valid),
        ]

        places, coefficients = self.tables()
        half = self.recurrence.half_unit
        coefficient_bits = int(self.recurrence.coefficient.max()).bit_length()
        for lane in range(self.lanes):
            depth = len(coefficients[lane])
            entry = data.StructLayout({"start": range(depth), "last": range(size)})
            m.submodules[f"places_{lane}"] = place = memory.Memory(
                shape=entry, depth=self.beats, init=places[lane]
            )
            m.submodules[f"coefficients_{lane}"] = table = memory.Memory(
                shape=coefficient_bits, depth=depth, init=coefficients[lane]
            )
            where, word = place.read_port(), table.read_port()
            beyond = row_1 > where.data.last
            address = Signal(range(depth), name=f"address_{lane}")
            m.d.comb += [
                address.eq(where.data.start + Mux(beyond, where.data.last, row_1)),
                where.addr.eq(beat),
                where.en.eq(advance),
                word.addr.eq(register(address, f"address_{lane}_held")),
                word.en.eq(advance),
            ]

            # Stage 4: operands. Stage 5: product. Stage 6: rounded sum.
            coefficient = register(word.data, f"coefficient_{lane}")
            past = Signal(read.data[lane].shape(), name=f"past_{lane}")
            m.d.comb += past.eq(Mux(first, 0, read.data[lane]))
            if self.downwards:
                operand = register(past - words[lane], f"operand_{lane}")
                addend = half
            else:
                operand = register(past, f"operand_{lane}")
                known = register(words[lane], f"known_{lane}")
                scaled = known << (self.recurrence.shift - self.recurrence.drop)
                addend = register(scaled + half, f"addend_{lane}")
            product = register(operand * coefficient, f"product_{lane}")
            total = register(product + addend, f"total_{lane}")
            m.d.comb += self.o.payload[lane].eq(total >> self.recurrence.shift)
        return m
