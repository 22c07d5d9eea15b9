"""Nothing lost, doubled or reordered: a property of streams whose beats leave as they entered."""

from amaranth import Mux, Signal, Value

from fastac.sim.formal.bench import FormalBench


class InOrder:
    """Assert that the beats which enter leave in the same order, each once and unchanged.

    A free input chooses one beat; its payload is caught, and the beats that are inside before it are
    counted. As any beat may be chosen, the property holds for all (P. Wolper, POPL 1986, data independence).

    Parameters
    ----------
    enters, payload : a beat enters in this clock, with this payload
    leaves, leaving : the same for beats that leave; a beat may leave in the clock in which it enters
    capacity : number of beats that can be inside between two clocks
    clear : the beats inside are discarded; one that enters in this clock stays

    Attributes
    ----------
    inside : number of beats that have entered and not left
    chosen, ahead, caught : the chosen beat is inside; number of beats before it; its payload
    """

    def __init__(
        self,
        bench: FormalBench,
        enters: Value,
        payload: Value,
        leaves: Value,
        leaving: Value,
        capacity: int,
        clear: Value | None = None,
    ):
        m = bench.m
        self.inside = Signal(range(capacity + 2))
        self.chosen = Signal()
        self.ahead = Signal(range(capacity + 1))
        self.caught = Signal(len(Value.cast(payload)), reset_less=True)
        choose = bench.free("choose")
        m.d.sync += self.inside.eq(self.inside + enters - leaves)
        now = Signal()  # the beat that enters is chosen
        first = Signal()  # the chosen beat is the next to leave
        m.d.comb += [
            now.eq(enters & choose & ~self.chosen),
            first.eq(Mux(self.chosen, self.ahead == 0, now & (self.inside == 0))),
        ]
        m.d.sync += self.chosen.eq((self.chosen | now) & ~(leaves & first))
        with m.If(now):
            m.d.sync += [self.caught.eq(payload), self.ahead.eq(self.inside - leaves)]
        with m.Elif(leaves):
            m.d.sync += self.ahead.eq(self.ahead - 1)
        if clear is not None:
            with m.If(clear):
                m.d.sync += [self.inside.eq(enters), self.chosen.eq(now), self.ahead.eq(0)]
        bench.always("no beat out of nothing", ~leaves | enters | (self.inside != 0))
        bench.always(f"at most {capacity} beats inside", self.inside <= capacity)
        bench.always("the chosen beat is inside", ~self.chosen | (self.ahead < self.inside))
        expected = Mux(self.chosen, self.caught, payload)
        bench.always("each beat once, in order, unchanged", ~(leaves & first) | (leaving == expected))

    def stored(self, bench: FormalBench, words: list[Value]) -> None:
        """Assert, for the induction, that beat k inside is `words[k]`."""
        for k, word in enumerate(words):
            held = self.chosen & (self.ahead == k)
            bench.always(f"beat {k} is stored", ~held | (Value.cast(word) == self.caught))
