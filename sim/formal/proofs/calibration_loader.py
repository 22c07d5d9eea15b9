"""Proof of the calibration loader: an incomplete calibration is never used, and a complete one is exact."""

from amaranth import Cat, Mux, Signal

from fastac.gateware.bus.calibration_loader import HASH, WORD, CalibrationLoader, ImageLayout
from fastac.gateware.stream.tables import TableFormat
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof

LAYOUT = ImageLayout(0x0F0F_1234, {"table": TableFormat(2, 2, 4)}, {"first": 5, "second": 40})
WORDS = LAYOUT.words
FIRST_OF_CHAIN = WORDS - LAYOUT.chain_words
REGISTERS = {"first": 19, "second": 0x12_3456_789A}
BUNDLE_HASH = 0x0123_4567_89AB_CDEF


def calibration_loader(component: type) -> FormalBench:
    """Words, restarts and frames in flight come at any time; a reset must change nothing."""
    bench = FormalBench(component(LAYOUT, REGISTERS, BUNDLE_HASH))
    m, dut, host = bench.m, bench.dut, bench.dut.host
    write, word = bench.free("write"), bench.free("word", WORD)
    idle, restart = bench.free("idle"), bench.free("restart")
    for port, value in ((host.write, write), (host.word, word), (host.idle, idle), (host.restart, restart)):
        bench.drive(port, value)

    bench.assume(~(write & restart))  # two registers of one bus

    # The words of the image under way, counted from what is taken. A reset leaves all as it is.
    count = Signal(range(WORDS), reset_less=True)
    known = (count != 0) | (word == LAYOUT.identifier)
    bench.always("a word is taken while no frame is in flight", host.taken == (write & idle & known))
    done = bench.wire("done", host.taken & (count == WORDS - 1))
    with m.If(restart):
        m.d.sync += count.eq(0)
    with m.Elif(host.taken):
        m.d.sync += count.eq(Mux(count == WORDS - 1, 0, count + 1))
    bench.always("`received` counts the words of an incomplete image", host.received == count)

    # From the first word on an image is incomplete until its last word is in the registers.
    active = Signal(reset_less=True)
    complete = Signal(reset_less=True)
    m.d.sync += complete.eq(done)
    with m.If(host.taken & (count != WORDS - 1)):
        m.d.sync += active.eq(1)
    with m.Elif(complete):
        m.d.sync += active.eq(0)
    bench.always("frames are kept out while an image is incomplete", host.loading == active)
    bench.always("an image under way is incomplete", (count == 0) | active)
    bench.always("the hash is 0 meanwhile", ~host.loading | (host.bundle_hash == 0))

    # Registers change only while an image is incomplete; the chosen word of the chain ends in its place.
    chain = bench.probe("chain", WORD * LAYOUT.chain_words)
    before = Signal(len(chain), reset_less=True, init=LAYOUT.chain(REGISTERS, BUNDLE_HASH))
    was_active = Signal(reset_less=True)
    m.d.sync += [before.eq(chain), was_active.eq(active)]
    bench.always("registers change only while an image is incomplete", was_active | (chain == before))
    bench.always("`first` is in the chain", dut.first == chain[:5])
    bench.always("`second` follows it", dut.second == chain[5:45])
    bench.always("the hash ends the chain", active | (host.bundle_hash == chain[-HASH:]))

    # A chosen word of the chain: where it is, from the clock on in which it is shifted in.
    chosen = bench.constant("chosen", range(LAYOUT.chain_words))
    pending = Signal(reset_less=True)  # the last word taken is shifted in now
    newest, older = Signal(WORD, reset_less=True), Signal(WORD, reset_less=True)
    placed, loaded = Signal(reset_less=True), Signal(reset_less=True)
    caught = Signal(WORD, reset_less=True)
    place = Signal(range(LAYOUT.chain_words), reset_less=True)
    is_chosen = Signal(reset_less=True)
    in_chain = bench.wire("in_chain", count >= FIRST_OF_CHAIN)
    m.d.sync += [pending.eq(host.taken & in_chain), is_chosen.eq(count == FIRST_OF_CHAIN + chosen)]
    with m.If(host.taken):
        m.d.sync += [newest.eq(word), older.eq(newest)]
    with m.If(pending & is_chosen):
        m.d.sync += [placed.eq(1), place.eq(LAYOUT.chain_words - 1), caught.eq(newest)]
    with m.Elif(pending):
        m.d.sync += [placed.eq(placed & (place != 0)), place.eq(place - 1)]
    with m.If(complete):
        m.d.sync += loaded.eq(1)
    with m.Elif(active):
        m.d.sync += loaded.eq(0)
    shifted = Signal(range(LAYOUT.chain_words + 1))  # words of this image in the chain
    m.d.comb += shifted.eq(
        Mux(complete, LAYOUT.chain_words, Mux(in_chain, count - FIRST_OF_CHAIN, 0)) - pending
    )
    there = (shifted > chosen) & ((count != 0) | complete)
    right = placed & (place == LAYOUT.chain_words - (shifted - chosen))
    bench.always("a word of the image is where it must be on its way", ~there | right)
    bench.always(
        "a complete image's words are in their places", ~loaded | active | (placed & (place == chosen))
    )
    bench.always("a word of the chain is unchanged", ~placed | (chain.word_select(place, WORD) == caught))
    bench.always("the loader shifts what was taken", bench.probe("shifts") == pending)
    bench.always("and the same word", ~pending | (bench.probe("word", WORD) == newest))
    bench.always("the last word is shifted before frames may start", ~complete | (pending & active))

    # Tables: a write for the last field of each word, with the fields taken last.
    table = dut.table
    index = bench.wire("index", count - 1)
    last_field = host.taken & (count != 0) & ~in_chain & index[0]
    writes, address = Signal(reset_less=True), Signal(1, reset_less=True)
    m.d.sync += [writes.eq(last_field), address.eq(index[1])]
    values = bench.probe("values", 2 * WORD)
    bench.always("the fields are the words taken last", values == Cat(older, newest))
    bench.always("a table's word is written once, with its last field", table.en == writes)
    bench.always("at its address", ~writes | (table.addr == address))
    bench.always("with its fields", ~writes | (table.data == Cat(older[:4], newest[:4])))
    section, position = bench.probe("section", range(3)), bench.probe("place", range(4))
    expected = Mux(count == 0, 0, Mux(in_chain, 2, 1))
    bench.always("the loader's section", section == expected)
    within = Mux(count == 0, 0, Mux(in_chain, count - FIRST_OF_CHAIN, index))
    bench.always("the loader's place in it", position == within)
    bench.always("the loader's end of an image", bench.probe("finished") == complete)
    return bench


PROOFS = (
    Proof(
        "calibration_loader",
        CalibrationLoader,
        "a table of two words of two fields, two registers of 45 bits: sections are counted one by one",
        calibration_loader,
        depth=2,
        breaks=(
            ("host.write & host.idle & (", "host.write & ("),
            ("finished.eq(host.taken & complete & ~host.restart)", "finished.eq(host.taken & in_chain)"),
            ("bundle_hash.eq(Mux(loading, 0, chain[-HASH:]))", "bundle_hash.eq(chain[-HASH:])"),
            (
                "m.d.sync += [received.eq(0), section.eq(0), place.eq(0)]",
                "m.d.sync += [received.eq(0), section.eq(0)]",
            ),
            ("loading = Signal(reset_less=True)", "loading = Signal()"),
            ("chain.eq(Cat(chain, word)[WORD:])", "chain.eq(Cat(word, chain))"),
            (" & place[:shift].all()", ""),
        ),
    ),
)
