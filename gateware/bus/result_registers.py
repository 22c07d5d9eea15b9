"""What a result leaves for the host: the registers of the last one, and for packets a record of each."""

from amaranth import Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.record import FORMAT_LOW, PLAIN, WORD_BITS, RecordFlag, RecordForm, record_form
from fastac.gateware.bus.register_map import ERRORS
from fastac.gateware.bus.result_fifo import ResultFifo
from fastac.models.integer.frame_validity import REASONS


def flags_word(*, form: RecordForm = PLAIN, **flags: Value) -> Value:
    """The word FLAGS of a record, with its format, from flags by their names in lower case; others are 0."""
    places = {flag.name.lower(): flag.bit_length() - 1 for flag in RecordFlag}
    bits = [Const(0, 1)] * FORMAT_LOW
    for name, value in flags.items():
        bits[places[name]] = value
    return Cat(bits, Const(form.number, WORD_BITS - FORMAT_LOW))


def record_value(*, form: RecordForm = PLAIN, **words: Value) -> Value:
    """A record, word 0 in the least significant bits, from words of up to 32 bits by name; others are 0.

    Raises ValueError for a name that a record lacks, and for a word of more bits.
    """
    if unknown := set(words) - set(form.words):
        raise ValueError(f"{min(unknown)}: expected one of {form.words}")
    padded = []
    for name in form.words:
        word = Value.cast(words.get(name, 0))
        if len(word) > WORD_BITS:
            raise ValueError(f"{name} of {len(word)} bits: expected at most {WORD_BITS}")
        padded.append(Cat(word, Const(0, WORD_BITS - len(word))))
    return Cat(padded)


def stamp_record(stamp, form: RecordForm = PLAIN) -> Value:
    """The record of a frame of which only its stamp (FrameTimer) is known; its flag `complete` is 0."""
    return record_value(
        form=form,
        FRAME=stamp.number,
        FLAGS=flags_word(form=form, bad=stamp.bad),
        TIME_LOW=stamp.time[:32],
        TIME_HIGH=stamp.time[32:],
    )


class ResultRegisters(wiring.Component):
    """Keep what comes with a result until the next one; with `identity.packets` make its record too.

    Members
    -------
    result : pulse: a frame's result is there
    validity : flags of the result's frame, sampled with it
    frame_validity : those of the last result
    force, spread, touching : see RegisterBlock, sampled with `result`. Force only with axes, the others only
        with slip.
    force_x and so on : signed(64), the last accumulator. Only for the axes there are.
    read_force_x and so on : the low half of that force is read, which latches the high half
    force_x_high and so on : the latched halves
    last_spread, last_touching : those of the last result. Only with slip.

    Only with half-widths:

    half_widths, half_widths_valid, sequence : of the last force, unsigned(half_width_bits) per axis; a pulse
        with them, after their force and before the next one; number of the frame of that force
    half_width_x and so on : unsigned(64), the last one. Only for the axes there are, as the next two.
    read_half_width_x and so on : the low half of that half-width is read, which latches the high half
    half_width_x_high and so on : the latched halves
    half_width_sequence : number of their frame

    Only with packets:

    frame, bad, first_to_result, last_to_result, result_time, time : outputs of FrameTimer
    slipping : the spread of the last result is beyond the limit
    errors : the register ERRORS
    read_time, time_high : the low half of `time` is read, which latches the high half
    clear, read : discard the records in the FIFO; take `word`, see ResultFifo
    word, waiting, lost, lost_count : see ResultFifo
    record : the record of the last result, valid while `record_valid` is high
    record_valid : pulse, once for each result, a clock after it, when FrameTimer has its times; with
        half-widths, a clock after them
    cut : a soft reset: half-widths that have not come will not come. Only with half-widths.
    """

    def __init__(self, identity: Identity):
        self.identity = identity
        members = {"result": In(1), "validity": In(len(REASONS)), "frame_validity": Out(len(REASONS))}
        if identity.axes:
            members["force"] = In(data.ArrayLayout(signed(identity.force_width), len(identity.axes)))
        for axis in identity.axes:
            members |= {
                f"read_force_{axis}": In(1),
                f"force_{axis}_high": Out(32),
                f"force_{axis}": Out(signed(64)),
            }
        if identity.slip:
            members |= {
                "spread": In(32),
                "touching": In(32),
                "last_spread": Out(32),
                "last_touching": Out(32),
            }
        if identity.half_width:
            halves = data.ArrayLayout(unsigned(identity.half_width_bits), len(identity.axes))
            members |= {"half_widths": In(halves), "half_widths_valid": In(1)}
            members |= {"sequence": In(32), "half_width_sequence": Out(32)}
            for axis in identity.axes:
                members |= {
                    f"read_half_width_{axis}": In(1),
                    f"half_width_{axis}_high": Out(32),
                    f"half_width_{axis}": Out(64),
                }
        if identity.packets:
            self.form = record_form(identity.half_width)
            self.fifo = ResultFifo(words=len(self.form.words))
            members |= {name: In(1) for name in ("bad", "slipping", "read_time", "clear", "read")}
            members |= {name: In(32) for name in ("frame", "first_to_result", "last_to_result")}
            members |= {name: In(64) for name in ("result_time", "time")}
            members |= {"errors": In(len(ERRORS)), "time_high": Out(32)}
            members |= {"record": Out(unsigned(self.form.bits)), "record_valid": Out(1)}
            if identity.half_width:
                members["cut"] = In(1)
            for name in ("word", "waiting", "lost", "lost_count"):
                members[name] = self.fifo.signature.members[name]
        super().__init__(members)

    @property
    def values(self) -> dict[str, Value]:
        """The values of registers, by their names in the register map."""
        found = {"FRAME_VALIDITY": self.frame_validity}
        for axis in self.identity.axes:
            found[f"FORCE_{axis.upper()}_LOW"] = getattr(self, f"force_{axis}")[:32]
            found[f"FORCE_{axis.upper()}_HIGH"] = getattr(self, f"force_{axis}_high")
        if self.identity.slip:
            found |= {"SLIP_SPREAD": self.last_spread, "SLIP_DOTS": self.last_touching}
        if self.identity.half_width:
            found["HALF_WIDTH_SEQUENCE"] = self.half_width_sequence
            for axis in self.identity.axes:
                found[f"HALF_WIDTH_{axis.upper()}_LOW"] = getattr(self, f"half_width_{axis}")[:32]
                found[f"HALF_WIDTH_{axis.upper()}_HIGH"] = getattr(self, f"half_width_{axis}_high")
        if self.identity.packets:
            found |= {"TIME_LOW": self.time[:32], "TIME_HIGH": self.time_high}
            found |= {"RESULTS_WAITING": self.waiting, "RESULTS_WORD": self.word}
            found["RESULTS_LOST"] = self.lost_count
        return found

    def elaborate(self, platform):
        m = Module()
        identity = self.identity
        with m.If(self.result):
            m.d.sync += self.frame_validity.eq(self.validity)
            if identity.slip:
                m.d.sync += [self.last_spread.eq(self.spread), self.last_touching.eq(self.touching)]
        for k, axis in enumerate(identity.axes):
            force, high = getattr(self, f"force_{axis}"), getattr(self, f"force_{axis}_high")
            with m.If(self.result):
                m.d.sync += force.eq(self.force[k])
            with m.If(getattr(self, f"read_force_{axis}")):
                m.d.sync += high.eq(force[32:])
        if identity.half_width:
            self._half_widths(m)
        if identity.packets:
            self._records(m)
        return m

    def _half_widths(self, m: Module) -> None:
        with m.If(self.half_widths_valid):
            m.d.sync += self.half_width_sequence.eq(self.sequence)
        for k, axis in enumerate(self.identity.axes):
            half, high = getattr(self, f"half_width_{axis}"), getattr(self, f"half_width_{axis}_high")
            with m.If(self.half_widths_valid):
                m.d.sync += half.eq(self.half_widths[k])
            with m.If(getattr(self, f"read_half_width_{axis}")):
                m.d.sync += high.eq(half[32:])

    def _records(self, m: Module) -> None:
        unknown = None
        if self.identity.half_width:
            # A result waits for its half-widths; a soft reset, which they do not survive, ends that.
            due, complete, unknown = Signal(name="record_due"), Signal(name="record_complete"), Signal()
            m.d.sync += [
                due.eq((due | self.result) & ~self.half_widths_valid & ~self.cut),
                complete.eq(self.half_widths_valid & ~self.cut),
            ]
            m.d.comb += [unknown.eq(due & self.cut), self.record_valid.eq(complete | unknown)]
        else:
            m.d.sync += self.record_valid.eq(self.result)
        with m.If(self.read_time):
            m.d.sync += self.time_high.eq(self.time[32:])
        words = {
            "FRAME": self.frame,
            "FLAGS": flags_word(
                form=self.form,
                bad=self.bad,
                suspect=self.frame_validity.any(),
                slip=self.slipping,
                complete=Const(1, 1),
            ),
            "VALIDITY": self.frame_validity,
            "ERRORS": self.errors,
            "TIME_LOW": self.result_time[:32],
            "TIME_HIGH": self.result_time[32:],
            "FIRST_TO_RESULT": self.first_to_result,
            "LAST_TO_RESULT": self.last_to_result,
        }
        for axis in self.identity.axes:
            force = getattr(self, f"force_{axis}")
            words |= {f"FORCE_{axis.upper()}_LOW": force[:32], f"FORCE_{axis.upper()}_HIGH": force[32:]}
            if self.identity.half_width:
                largest = Const((1 << self.identity.half_width_bits) - 1, 64)
                half = Mux(unknown, largest, getattr(self, f"half_width_{axis}"))
                words |= {f"HALF_WIDTH_{axis.upper()}_LOW": half[:32]}
                words |= {f"HALF_WIDTH_{axis.upper()}_HIGH": half[32:]}
        if self.identity.slip:
            words |= {"SLIP_SPREAD": self.last_spread, "SLIP_DOTS": self.last_touching}
        m.submodules.fifo = fifo = self.fifo
        m.d.comb += [
            self.record.eq(record_value(form=self.form, **words)),
            fifo.record.eq(self.record),
            fifo.record_valid.eq(self.record_valid),
            fifo.read.eq(self.read),
            fifo.clear.eq(self.clear),
            *(getattr(self, n).eq(getattr(fifo, n)) for n in ("word", "waiting", "lost", "lost_count")),
        ]
