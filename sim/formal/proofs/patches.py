"""Proof of the patch generator: every patch has the samples around its pixel, zeros outside the frame.

The proof follows one sample of every frame, at a place that is a free constant, by its age: the number of
steps of the pipeline since its beat was taken. The line buffers and the window hold what has each age at one
place, and a patch leaves a fixed number of steps after its pixel: these are the invariants.
"""

from functools import partial

from amaranth import Array, Const, Mux, Signal, Value

from fastac.gateware.force.patch_generator import PatchGenerator
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.frame_order import FrameOrder
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.reordering import opened

BITS = 1
"""Bits of a sample, which is only stored."""


def patches(component: type, size: int, kernel_size: int, lanes: int) -> FormalBench:
    """Each sample is in every patch around it, at its place, and nothing else is."""
    dut = component(size, kernel_size, BITS, lanes=lanes)
    ports = opened(dut).submodules.rows
    read = Value.cast(ports.read_ports[0].data)
    write_address = ports.write_ports[0].addr
    bench = FormalBench(dut)
    m, half, beats, places, reach = bench.m, kernel_size // 2, dut.row_beats, dut.interval, dut.reach
    enters, payload = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    r, c = bench.constant("r", range(size)), bench.constant("c", range(size))
    lane = bench.wire("lane", c % lanes)
    entry = bench.wire("entry", r * beats + c // lanes)
    value = payload.word_select(lane, BITS)
    order = FrameOrder(bench, enters, leaves, beats=places, entry=entry, value=value)

    # What must leave.
    row_out, beat_out = order.place_out // beats, order.place_out % beats
    out = Value.cast(dut.o.payload)
    inside, outside = Const(1), Const(1)
    for k in range(lanes):
        pixel = beat_out * lanes + k
        offered = dut.o.valid & (pixel < size)
        for place in range(kernel_size**2):
            y, x = row_out + place // kernel_size - half, pixel + place % kernel_size - half
            sample = out.word_select(k * kernel_size**2 + place, BITS)
            here = offered & (y == r) & (x == c)
            inside &= ~here | (sample == order.caught[order.frame_out])
            within = (y >= 0) & (y < size) & (x >= 0) & (x < size)
            outside &= ~offered | within | (sample == 0)
    bench.always("each sample at its place in the patches around it, unchanged", inside)
    bench.always("zeros outside the frame", outside)
    bench.always("no deadlock: takes a beat while patches are taken", dut.i.ready | ~dut.o.ready)
    complete = (order.held > reach) | ((order.place_in == 0) & (order.held > 0))
    order.progress(1, complete, 3)

    # For the induction: steps since the previous frame, and what is emitted next.
    valid, stepped = bench.probe("valid", 3), bench.probe("stepped")
    index, owed = bench.probe("index", range(places)), bench.probe("owed", range(reach + 1))
    advance, step = bench.probe("advance"), bench.probe("step")
    long = reach + 2
    after = Signal(range(long + 1), init=long)  # steps since the previous frame's last beat, or many
    with m.If(enters & (order.place_in == places - 1)):
        m.d.sync += after.eq(0)
    with m.Elif(advance & step & (after < long)):
        m.d.sync += after.eq(after + 1)
    bench.always("index is the place of the next beat", index == order.place_in)
    bench.always("patches owed", owed == Mux(after < reach, reach - after, 0))
    bench.always("beats of a frame are steps", (after <= long) & ((index <= after) | (after == long)))
    flight = [valid[2], valid[1] + valid[2], valid[0] + valid[1] + valid[2]]
    (p1, f1), (p0, f0), (pe, fe) = (order.left.after(n) for n in flight)
    before = (order.frame_in - 1)[:2]
    ends = (fe == before) & (pe == places - reach + after)
    goes = (fe == order.frame_in) & (pe == Mux(index > reach, index - reach, 0))
    bench.always("what is emitted next", Mux(after < reach, ends, goes))
    bench.always("patches are emitted by steps", ~valid[0] | stepped)
    for name, here, p, f, late in (("read", valid[0], p0, f0, 0), ("shifted", valid[1], p1, f1, stepped)):
        newer = (f == order.frame_in) & (index - late == p + reach + 1)
        older = (f == before) & (places + after - late == p + reach + 1)
        bench.always(f"what is {name} belongs to its patch", ~here | newer | older)

    # Where the sample is in the line buffers and in the window, of this frame and of the previous one.
    place = bench.probe("place", range(beats))
    newest = bench.probe("newest", lanes * BITS)
    words = Array(bench.probe(f"rows[{k}]", (kernel_size - 1) * lanes * BITS) for k in range(beats))
    kept = half + (dut.column_delay + 1) * lanes
    window = [[bench.probe(f"w_{y}_{x}", BITS) for x in range(kept)] for y in range(kernel_size)]
    bench.always("the line buffers' place", place < beats)
    latest = Mux(place == 0, beats - 1, place - 1)
    bench.always("the place that is written back", ~stepped | (write_address == latest))
    for name, there, age, known in (
        ("this", index > entry, index - entry, order.caught[order.frame_in]),
        ("the previous", after < long, places - entry + after, order.caught[before]),
    ):
        age = bench.wire(f"age_in_{name.split()[-1]}_frame", age)
        bench.always(
            f"newest beat, {name} frame", ~there | (age != 1) | (newest.word_select(lane, BITS) == known)
        )
        for k in range(kernel_size - 1):
            held = read.word_select(k * lanes + lane, BITS) == known
            bench.always(f"row {k} that was read, {name} frame", ~there | (age != 1 + (k + 1) * beats) | held)
        for steps in range(1, (kernel_size - 1) * beats + 1 + beats):
            back, above = (steps - 1) % beats, (steps - 1) // beats
            if back == 0:
                above = Mux(stepped, above - 1, above)
                holds = ~there | (age != steps) | (above < 0) | (above > kernel_size - 2)
            elif above > kernel_size - 2:
                continue
            else:
                holds = ~there | (age != steps)
            address = Mux(place > back, place - back - 1, place + beats - back - 1)
            word = words[address].word_select((above * lanes + lane)[:4], BITS)
            bench.always(f"line buffers after {steps} steps, {name} frame", holds | (word == known))
        for y in range(kernel_size):
            held = Const(1)
            for x in range(kept):
                turn, at = divmod(kept - 1 - x, lanes)
                shifted = age - stepped == 1 + (kernel_size - 1 - y) * beats + turn
                held &= ~(shifted & (lane == lanes - 1 - at)) | (window[y][x] == known)
            bench.always(f"row {y} of the window, {name} frame", ~there | held)

    # Which samples of the window are inside the frame.
    row, beat = bench.probe("row", range(size)), bench.probe("beat", range(beats))
    bench.always("row and beat of the next patch", (row * beats + beat == p0) & (row < size) & (beat < beats))
    rows, columns = bench.probe("rows_inside", kernel_size), bench.probe("columns_inside", lanes + 2 * half)
    for y in range(kernel_size):
        at = p1 // beats + y - half
        bench.always(f"row {y} is inside", ~valid[1] | (rows[y] == ((at >= 0) & (at < size))))
    for x in range(lanes + 2 * half):
        at = (p1 % beats) * lanes + x - half
        bench.always(f"column {x} is inside", ~valid[1] | (columns[x] == ((at >= 0) & (at < size))))
    bench.always("a clock to the window", ~(order.waited == 1) | valid.any())
    bench.always("two clocks to the border", ~(order.waited == 2) | valid[1:].any())
    return bench


PROOFS = tuple(
    Proof(
        f"patch_generator_{size}_{kernel_size}_{lanes}",
        PatchGenerator,
        f"{size} × {size} samples of {BITS} bit, {lanes} a beat, patches of {kernel_size} × {kernel_size};"
        " a larger frame has more of the same rows and columns",
        partial(patches, size=size, kernel_size=kernel_size, lanes=lanes),
        depth=1,
        breaks=(
            ("emit.eq((index >= self.reach) | owed.any())", "emit.eq(index >= self.reach)"),
            ("owed.eq(self.reach)", "owed.eq(self.reach - 1)"),
            ("write.en.eq(advance & stepped)", "write.en.eq(stepped)"),
            ("rows_inside[r] & columns_inside[c]", "columns_inside[c]"),
            ("(row >= above)", "(row > above)"),
        ),
        broken_depth=30,
    )
    for size, kernel_size, lanes in ((3, 3, 1), (4, 3, 2), (5, 5, 4))
)
