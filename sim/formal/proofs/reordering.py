"""Proofs of the frame buffers that change the order of values: transposer, reversal of the rows."""

from functools import partial

from amaranth import Array, Mux, Value
from amaranth.lib import wiring

from fastac.gateware.poisson.frame_reversal import FrameReversal
from fastac.gateware.poisson.in_place_transposer import InPlaceTransposer
from fastac.gateware.poisson.transposer import Transposer
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.frame_order import FrameOrder
from fastac.sim.formal.proof import Proof

WIDTH = 2
"""Bits of a value, which these components only store."""
PAGES = (
    ("~Mux(write_page, full[1], full[0])", "~(full[0] & write_page)"),
    ("emptied.eq(1 << read_page)", "emptied.eq(3)"),
    ("advance.eq(self.o.ready | ~self.o.valid)", "advance.eq(1)"),
    ("following >> (self.lanes - 1).bit_length()", "column >> (self.lanes - 1).bit_length()"),
)
BANKS = ("column_read & (self.lanes - 1)", "column & (self.lanes - 1)")
"""Faults of the transposer's pages, and one of the lanes' banks."""


def opened(dut: wiring.Component):
    """Elaborate `dut` now; returns its module, whose submodules' ports an invariant may then name."""
    module = dut.elaborate(None)
    dut.elaborate = lambda platform: module
    return module


def transposer(component: type, size: int, lanes: int) -> FormalBench:
    """Value (r, c) of a frame leaves as value (c, r) of the same frame, unchanged, whatever the resets."""
    dut = component(size, WIDTH, lanes=lanes)
    memories = opened(dut).submodules
    bench = FormalBench(dut)
    beats, words, places = dut.beats, dut.page_words, size * dut.beats
    enters, payload = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    r, c = (bench.constant(name, range(size)) for name in ("r", "c"))
    entry, exit = (bench.wire(*named) for named in (
        ("entry", r * beats + c // lanes), ("exit", c * beats + r // lanes)
    ))  # fmt: skip
    value = payload.word_select(c % lanes, WIDTH)
    order = FrameOrder(bench, enters, leaves, beats=places, entry=entry, value=value)
    order.expect(exit, Value.cast(dut.o.payload).word_select(r % lanes, WIDTH))

    # For the induction: where writer and reader are, which pages are full, where the tracked value is.
    full, valid = bench.probe("full", 2), bench.probe("valid", 2)
    write_page, read_page = bench.probe("write_page"), bench.probe("read_page")
    row, column = bench.probe("row", range(size)), bench.probe("column", range(size))
    row_beat, column_beat = (bench.probe(f"{name}_beat", range(beats)) for name in ("row", "column"))
    write_address, base = (bench.probe(name, range(2 * words)) for name in ("write_address", "base"))
    column_read = bench.probe("column_read", range(size))
    banks = Array(
        Array(bench.probe(f"bank_{bank}[{k}]", WIDTH) for k in range(2 * words)) for bank in range(lanes)
    )
    read = Array(
        Value.cast(getattr(memories, f"bank_{bank}").read_ports[0].data).as_unsigned()
        for bank in range(lanes)
    )

    bench.always("row and beat are the writer's place", row * beats + row_beat == order.place_in)
    bench.always("the writer's beat is in its row", (row < size) & (row_beat < beats))
    bench.always("the writer's page is its frame's", write_page == order.frame_in[0])
    bench.always("the writer's address", write_address == write_page * words + order.place_in)

    issued, issued_frame = order.left.after(valid[0] + valid[1])
    issued_frame = bench.wire("issued_frame", issued_frame)
    pages = bench.wire("pages", (order.frame_in - issued_frame)[:2])
    bench.always("column and beat are the reader's place", column * beats + column_beat == issued)
    bench.always("the reader's beat is in its column", (column < size) & (column_beat < beats))
    bench.always("the reader's page is its frame's", read_page == issued_frame[0])
    bench.always(
        "the reader's address",
        base == read_page * words + (column // lanes) + column_beat * (lanes * beats),
    )
    bench.always("as many pages are full as frames wait", (pages == full[0] + full[1]) & (pages <= 2))
    bench.always("the full page is the reader's", (pages != 1) | Mux(read_page, full[1], full[0]))
    bench.always("the reader begins with a full page", (pages != 0) | (issued == 0))
    bench.always("the writer waits while both are full", (pages != 2) | (order.place_in == 0))

    bank = (r + c) % lanes
    for behind in range(2):
        frame = (issued_frame + behind)[:2]
        there = (behind < pages) | ((behind == pages) & (order.place_in > entry))
        word = banks[bank][frame[0] * words + entry]
        bench.always(f"page {behind} holds the value", ~there | (word == order.caught[frame]))
    place, frame = order.left.after(valid[1])
    due = valid[0] & (place == exit)
    bench.always("the memory's register holds the value", ~due | (read[bank] == order.caught[frame]))
    bench.always(
        "the column that was read",
        ~valid[0] | ((column_read * beats <= place) & (place < (column_read + 1) * beats)),
    )
    order.progress(places, order.frame_in != order.frame_out, 2)
    bench.always("one clock to the memory's register", ~(order.waited == 1) | valid.any())
    return bench


def reversal(component: type, size: int, lanes: int) -> FormalBench:
    """Beat b of row r of a frame leaves as beat b of row size − 1 − r of the same frame, unchanged."""
    dut = component(size, WIDTH, lanes=lanes)
    memory = opened(dut).submodules.page
    bench = FormalBench(dut)
    beats, places = dut.beats, size * dut.beats
    enters, payload = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    r, b = bench.constant("r", range(size)), bench.constant("b", range(beats))
    entry = bench.wire("entry", r * beats + b)
    mirrored = bench.wire("mirrored", (size - 1 - r) * beats + b)
    order = FrameOrder(bench, enters, leaves, beats=places, entry=entry, value=payload)
    order.expect(mirrored, Value.cast(dut.o.payload))

    # For the induction: where writer and reader are, and where in the memory the tracked beat is.
    valid, whole = bench.probe("valid", 2), bench.probe("whole")
    words = Array(bench.probe(f"page[{k}]", len(payload)) for k in range(places))
    read = Value.cast(memory.read_ports[0].data)
    issued, issued_frame = order.left.after(valid[0] + valid[1])
    issued, issued_frame = bench.wire("issued", issued), bench.wire("issued_frame", issued_frame)
    walks = (("write", order.place_in, order.frame_in[0]), ("read", issued, ~issued_frame[0]))
    for name, place, downwards in walks:
        row, beat = bench.probe(f"{name}_row", range(size)), bench.probe(f"{name}_beat", range(beats))
        bench.always(f"{name}: row and beat are its place", row * beats + beat == place)
        bench.always(f"{name}: the beat is in its row", (row < size) & (beat < beats))
        bench.always(f"{name}: direction", bench.probe(f"{name}_up") == ~downwards)
        across = (size - 1 - row) * beats + beat
        address = bench.probe(f"{name}_address", range(places))
        bench.always(f"{name}: address", address == Mux(downwards, across, place))
    bench.always(
        "a whole frame is between writer and reader",
        order.frame_in == (issued_frame + whole)[:2],
    )
    bench.always("the writer is behind the reader", ~whole | (order.place_in <= issued))
    follows = Mux(order.place_in >= places - beats, order.place_in - (places - beats), 0)
    bench.always("the reader is behind the writer", whole | (issued <= follows))

    for frame, there, name in (
        (order.frame_in, order.place_in > entry, "begun"),
        (issued_frame, whole & (issued <= mirrored), "whole"),
    ):
        word = words[Mux(frame[0], mirrored, entry)]
        bench.always(f"the frame that is {name} holds the beat", ~there | (word == order.caught[frame]))
    place, frame = order.left.after(valid[1])
    due = valid[0] & (place == mirrored)
    bench.always("the memory's register holds the beat", ~due | (read == order.caught[frame]))
    order.progress(places, order.frame_in != order.frame_out, 2)
    bench.always("one clock to the memory's register", ~(order.waited == 1) | valid.any())
    return bench


def in_place(component: type, size: int, fold: int) -> FormalBench:
    """As `transposer`, with one page, whose frames lie by rows and by columns in turn."""
    dut = component(size, WIDTH, fold=fold)
    memory = opened(dut).submodules.page
    bench = FormalBench(dut)
    places = size * size
    enters, payload = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    r, c = (bench.constant(name, range(size)) for name in ("r", "c"))
    entry, exit = bench.wire("entry", r * size + c), bench.wire("exit", c * size + r)
    order = FrameOrder(bench, enters, leaves, beats=places, entry=entry, value=payload)
    order.expect(exit, Value.cast(dut.o.payload))

    # For the induction: where writer and reader are, and where in the memory the tracked value is.
    valid, whole, since = bench.probe("valid", 2), bench.probe("whole"), bench.probe("pace", range(fold))
    words = Array(bench.probe(f"page[{k}]", WIDTH) for k in range(places))
    read = Value.cast(memory.read_ports[0].data)
    issued, issued_frame = order.left.after(valid[0] + valid[1])
    issued, issued_frame = bench.wire("issued", issued), bench.wire("issued_frame", issued_frame)
    walks = (("write", order.place_in, order.frame_in[0]), ("read", issued, ~issued_frame[0]))
    for name, at, across in walks:
        line, place = bench.probe(f"{name}_line", range(size)), bench.probe(f"{name}_place", range(size))
        bench.always(f"{name}: line and place", line * size + place == at)
        bench.always(f"{name}: the place is in its line", (line < size) & (place < size))
        bench.always(f"{name}: direction", bench.probe(f"{name}_across") == across)
        address = bench.probe(f"{name}_address", range(places))
        bench.always(f"{name}: address", address == Mux(across, place * size + line, at))
    bench.always(
        "a whole frame is between writer and reader",
        order.frame_in == (issued_frame + whole)[:2],
    )
    bench.always("the writer is behind the reader", ~whole | (order.place_in <= issued))
    bench.always("the reader begins with a whole frame", whole | (issued == 0))
    for frame, there, name in (
        (order.frame_in, order.place_in > entry, "begun"),
        (issued_frame, whole & (issued <= exit), "whole"),
    ):
        word = words[Mux(frame[0], exit, entry)]
        bench.always(f"the frame that is {name} holds the value", ~there | (word == order.caught[frame]))
    place, frame = order.left.after(valid[1])
    due = valid[0] & (place == exit)
    bench.always("the memory's register holds the value", ~due | (read == order.caught[frame]))
    order.progress(places, order.frame_in != order.frame_out, fold + 1)
    bench.always("clocks since the last one", since < fold)
    for k in range(1, fold + 1):
        reached = valid.any() | (since >= k if k < fold else 0)
        bench.always(f"a frame that waits for {k} clocks", (order.waited != k) | reached)
    return bench


SIZE = "{0} × {0} values of 2 bits, {1} a beat; a larger frame has more of the same rows and columns"

PROOFS = (
    *(
        Proof(
            f"transposer_{size}_{lanes}",
            Transposer,
            SIZE.format(size, lanes),
            partial(transposer, size=size, lanes=lanes),
            depth=1,
            breaks=breaks,
            broken_depth=30,
            quick=size * lanes == 6,
        )
        for size, lanes, breaks in (
            (3, 1, PAGES),
            (3, 2, (*PAGES, BANKS)),
            (5, 4, (BANKS,)),
        )
    ),
    *(
        Proof(
            f"frame_reversal_{size}_{lanes}",
            FrameReversal,
            SIZE.format(size, lanes),
            partial(reversal, size=size, lanes=lanes),
            depth=1,
            breaks=(
                ("~whole | (written.address != taken.address)", "1"),
                ("taken.beat < written.beat", "taken.beat <= written.beat"),
                ("advance.eq(self.o.ready | ~self.o.valid)", "advance.eq(1)"),
                ("up.eq(~up)", "up.eq(up)"),
            ),
            broken_depth=30,
        )
        for size, lanes in ((3, 1), (4, 2), (5, 4))
    ),
    Proof(
        "in_place_transposer",
        InPlaceTransposer,
        "3 × 3 values of 2 bits, every 2 clocks; a larger frame has more of the same rows and columns",
        partial(in_place, size=3, fold=2),
        depth=1,
        breaks=(
            ("~whole | (written.address != taken.address)", "1"),
            ("advance.eq(self.o.ready | ~self.o.valid)", "advance.eq(1)"),
            ("across.eq(~across)", "across.eq(across)"),
            ("end * self.size - 1, -1", "end * self.size, -1"),
        ),
        broken_depth=30,
    ),
)
