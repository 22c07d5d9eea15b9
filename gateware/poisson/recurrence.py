"""The two recurrences of the tridiagonal solver: elimination down the rows, substitution up the rows."""

from amaranth import Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import pipeline_handshake
from fastac.models.integer.tridiagonal import Recurrence


class RowRecurrence(wiring.Component):
    """Run `recurrence`, an Elimination or a Substitution, over frames of N × N values, `lanes` modes a clock.

    Each row needs the one before it, mode by mode, which waits in a memory of one row. A lane has one
    multiplier, one DSP48E2 where the words have 26 bits: pre-adder (elimination), product, and the sum that
    rounds. A lane's coefficients lie mode after mode in one table, each mode's rows up to the one from which
    on they stay the same; the place is start[mode] + min(row, last[mode]).

    Members
    -------
    i : stream of `lanes` values, signed(recurrence.input_width): N rows of `beats` = ceil(N/lanes) beats;
        elimination takes them first to last, substitution last to first
    o : stream of `lanes` values, signed(recurrence.output_width), in the same order

    Lanes beyond N in the last beat of a row are void. A beat is accepted every clock while `o` is free;
    `latency` = 6 clocks pass from it to its values if nothing stalls. `loop` = 5 of them lie between the
    reading of a value of the row before and that of its successor, so rows must have as many beats.
    """

    latency = 6
    loop = 5

    def __init__(self, recurrence: Recurrence, *, lanes: int):
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        if not isinstance(recurrence, Recurrence):
            raise ValueError(f"recurrence {type(recurrence).__name__}: expected Elimination or Substitution")
        self.recurrence, self.lanes = recurrence, lanes
        self.downwards = recurrence.downwards
        self.beats = -(-recurrence.size // lanes)
        if self.beats < self.loop:
            raise ValueError(
                f"rows of {recurrence.size} values, {self.beats} beats: expected at least {self.loop} beats,"
                " the clocks that a value takes to reach its successor"
            )
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(recurrence.input_width), lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(recurrence.output_width), lanes))),
            }
        )

    @staticmethod
    def multipliers_of(lanes: int) -> int:
        return lanes

    @property
    def multipliers(self) -> int:
        return self.multipliers_of(self.lanes)

    def tables(self) -> tuple[list[list[dict[str, int]]], list[list[int]]]:
        """Each lane's {start, last} by beats, and its coefficients mode after mode."""
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
            """`value` some steps later; no reset on data."""
            for step in range(steps):
                held = Signal(value.shape(), reset_less=True, name=f"{name}_{step}" if steps > 1 else name)
                with m.If(advance):
                    m.d.sync += held.eq(value)
                value = held
            return value

        # 1: the place of the modes' coefficients; rows count in the order of the coefficients.
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

        # 2: the address. 3: coefficients, and the values of the row before; they are written with the output.
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

            # 4: the operands. 5: the product. 6: the rounded sum.
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
