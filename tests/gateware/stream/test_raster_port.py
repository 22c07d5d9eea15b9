# amaranth: UnusedElaboratable=no
"""RasterPort with random pauses and random resets of its source, under Amaranth's own simulator."""

import random

import pytest
from amaranth.sim import Simulator

from fastac.gateware.stream.raster_port import RasterPort

CLOCKS = 3000
ROWS, BEATS, OCTETS = 3, 4, 2
FRAME = ROWS * BEATS


class Source:
    """Frames of random words, of which none is 0, with random flags; begins a new one after a reset."""

    def __init__(self, rng: random.Random):
        self.rng = rng
        self.restart()

    def restart(self) -> None:
        self.position, self.bad, self.suspect = 0, self.rng.getrandbits(1), self.rng.getrandbits(1)
        self.word, self.offered = self.rng.randrange(1, 1 << 8 * OCTETS), False

    def taken(self) -> None:
        self.position += 1
        self.word, self.offered = self.rng.randrange(1, 1 << 8 * OCTETS), False
        if self.position == FRAME:
            self.restart()


def run(dut: RasterPort, *, rest: float, stall: float, cut: float, seed: int):
    """Check every clock; returns the beats taken, (tdata, tlast, tuser, tkeep), and how often what happened.

    rest, stall, cut : probabilities per clock of no new offer, of an output that is not ready, of a reset
    """
    found, events = [], {"offered": 0, "inside": 0, "between": 0, "idle": 0, "closing": 0, "done": 0}

    async def bench(ctx):
        rng = random.Random(seed)
        source, held, closing, position = Source(rng), None, False, 0
        for clock in range(CLOCKS):
            if not source.offered:
                source.offered = rng.random() >= rest
            cuts = rng.random() < cut and clock > 0
            ctx.set(dut.i.valid, source.offered)
            ctx.set(dut.i.payload, source.word if source.offered else 0)
            ctx.set(dut.port.tready, rng.random() >= stall)
            ctx.set(dut.cut, cuts)
            if dut.tagged:
                ctx.set(dut.bad, source.bad)
                ctx.set(dut.suspect, source.suspect)
            names = ("tdata", "tlast", "tuser", *(["tkeep"] if dut.tagged else []))
            offer = tuple(ctx.get(getattr(dut.port, name)) for name in names)
            valid, ready = ctx.get(dut.port.tvalid), ctx.get(dut.port.tready)
            passes = ctx.get(dut.i.ready) and source.offered
            if held is not None:
                assert valid, f"clock {clock}: an offer was withdrawn"
                assert offer == held, f"clock {clock}: an offer was changed"
            if not closing:
                assert valid == source.offered, f"clock {clock}: latency is not 0"
                assert passes == (valid and ready)
            held = offer if valid and not ready else None
            assert ctx.get(dut.done) == (passes and position == FRAME - 1)
            events["done"] += ctx.get(dut.done)
            if valid:
                y, x = divmod(position, BEATS)
                word, bad, suspect = (0, 1, 0) if closing else (source.word, source.bad, source.suspect)
                if closing and closing != "zeros":
                    word, bad, suspect = closing
                row = ROWS - 1 - y if dut.rows_reversed else y
                user = (position == 0) | (bad << 1 | row << 2 | suspect << 10 if dut.tagged else 0)
                keep = (1 << OCTETS) - 1 >> dut.void_octets * (x == BEATS - 1)
                wanted = (word, int(x == BEATS - 1), user, *([keep] if dut.tagged else []))
                assert offer == wanted, f"clock {clock}: {offer}, expected {wanted}"
            if valid and ready:
                found.append(offer)
                position = (position + 1) % FRAME
                if closing:
                    closing = "zeros" if position else False
            if cuts:
                if closing or (valid and ready and not passes):
                    events["closing"] += 1
                elif source.offered and not ready:
                    closing = (source.word, source.bad, source.suspect)
                    events["offered"] += 1
                else:
                    closing = "zeros" if position else False
                    events["inside" if position else "between" if valid else "idle"] += 1
                source.restart()
            elif passes:
                source.taken()
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    return found, events


PORTS = {
    "tagged": {"tagged": True},
    "last row first, void bytes": {"tagged": True, "void_octets": 1, "rows_reversed": True},
    "untagged": {"tagged": False},
}


@pytest.mark.parametrize("port", PORTS)
def test_frames_stay_whole(port):
    found, events = run(RasterPort(ROWS, BEATS, OCTETS, **PORTS[port]), rest=0.3, stall=0.5, cut=0.05, seed=1)
    assert min(events.values()) > 0, f"{events}: each kind of reset is wanted"
    assert len(found) > CLOCKS // 4


def test_without_resets_every_beat_passes_at_once():
    found, events = run(RasterPort(ROWS, BEATS, OCTETS, tagged=True), rest=0, stall=0, cut=0, seed=1)
    assert len(found) == CLOCKS
    assert events["done"] == CLOCKS // FRAME


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rows": 0}, "rows 0: expected at least 1"),
        ({"rows": 257}, "rows 257: expected at most 256"),
        ({"beats": 0}, "beats 0: expected at least 1"),
        ({"octets": 0}, "octets 0: expected at least 1"),
        ({"void_octets": 4}, "void_octets 4: expected 0 to 3"),
    ],
)
def test_invalid_arguments(changed, message):
    arguments = {"rows": 3, "beats": 4, "octets": 4, "tagged": True} | changed
    with pytest.raises(ValueError, match=message):
        RasterPort(**arguments)
