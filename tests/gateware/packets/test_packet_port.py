# amaranth: UnusedElaboratable=no
"""PacketPort with random pauses, late records and random resets of its sources, against a plain loop."""

import random

import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.bus.record import PLAIN, RECORD_BYTES
from fastac.gateware.packets.packet_port import ABORTED, PacketPort

CLOCKS = 2500
ROWS, BEATS, OCTETS = 3, 4, 4
FRAME = ROWS * BEATS
FIRST = 1000
"""Number of the first frame: so that no word of an aborted record is like one of an image."""


class Source:
    """Numbered frames and their records; begins another frame after a reset.

    Beat k of frame n has the word 64 n + k + 1, and its record n in its lowest bits. The record comes with
    the beat before the frame's last one, or up to 30 clocks later.
    """

    def __init__(self, rng: random.Random):
        self.rng, self.number, self.position, self.offered = rng, FIRST, 0, False
        self.waiting: list[tuple[int, int]] = []  # (clock from which a record is offered, frame)
        self.records: dict[int, int] = {}

    @property
    def word(self) -> int:
        return 64 * self.number + self.position + 1

    def begin(self) -> None:
        self.number, self.position, self.offered = self.number + 1, 0, False

    def taken(self, clock: int) -> None:
        self.position, self.offered = self.position + 1, False
        if self.position == FRAME - 1:
            self.records[self.number] = self.number | self.rng.getrandbits(480) << 32
            self.waiting.append((clock + self.rng.choice([0, 1, 2, 5, 30]), self.number))
        if self.position == FRAME:
            self.begin()

    def record(self, clock: int) -> int | None:
        """The frame whose record is offered."""
        return self.waiting[0][1] if self.waiting and self.waiting[0][0] <= clock else None


def run(dut: PacketPort, *, rest: float, stall: float, cut: float, seed: int, clocks: int = CLOCKS):
    """Check each clock for the rules of AXI; returns (packets, records, fate).

    packets : lists of words; records : {frame: its record}
    fate : {frame: "whole" or "aborted"} of those that a packet must come of, but for those under way at the
        end
    """
    packets, fate, begun, loaded, complete = [[]], {}, set(), set(), set()
    rng = random.Random(seed)
    source = Source(rng)

    async def bench(ctx):
        held = None
        for clock in range(clocks):
            source.offered = source.offered or rng.random() >= rest
            cuts, record = rng.random() < cut and clock > 0, source.record(clock)
            ctx.set(dut.i.valid, source.offered)
            ctx.set(dut.i.payload, source.word if source.offered else rng.getrandbits(8 * OCTETS))
            ctx.set(dut.record.valid, record is not None)
            ctx.set(dut.record.payload, rng.getrandbits(512) if record is None else source.records[record])
            ctx.set(dut.port.tready, rng.random() >= stall)
            ctx.set(dut.cut, cuts)
            valid, ready = ctx.get(dut.port.tvalid), ctx.get(dut.port.tready)
            offer = ctx.get(dut.port.tdata), ctx.get(dut.port.tlast), ctx.get(dut.port.tkeep)
            if held is not None:
                assert valid, f"clock {clock}: an offer was withdrawn"
                assert offer == held, f"clock {clock}: an offer was changed"
            held = offer if valid and not ready else None
            if valid and ready:
                assert offer[2] == (1 << OCTETS) - 1
                packets[-1].append(offer[0])
                if offer[1]:
                    packets.append([])
            if valid and source.offered and offer[0] & ~0x3F == source.word & ~0x3F:
                begun.add(source.number)
            if cuts:
                for number in begun - fate.keys():
                    last = source.number == number and source.position == FRAME - 1
                    whole = number in complete or (last and source.offered and ctx.get(dut.i.ready))
                    fate[number] = "whole" if number in loaded and whole else "aborted"
                if record is not None and ctx.get(dut.record.ready):
                    source.waiting.pop(0)
                source.waiting.clear()
                source.begin()
            else:
                if ctx.get(dut.i.ready) and source.offered:
                    if source.position == FRAME - 1:
                        complete.add(source.number)
                    source.taken(clock)
                if record is not None and ctx.get(dut.record.ready):
                    source.waiting.pop(0)
                    loaded.add(record)
                for number in complete & loaded:
                    fate.setdefault(number, "whole")
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    return packets[:-1], source.records, fate


def trailer(dut: PacketPort, record: int) -> list[int]:
    """The words of a record's beats."""
    beats, mask = -(-RECORD_BYTES // dut.octets), (1 << 8 * dut.octets) - 1
    return [record >> 8 * dut.octets * k & mask for k in range(beats)]


def image(number: int, beats: int, void: int = 0) -> list[int]:
    """The words of a frame of which so many beats came, the rest as zeros, void bytes too."""
    words = [(64 * number + k + 1) * (k < beats) for k in range(FRAME)]
    keep = (1 << 8 * (OCTETS - void)) - 1
    return [word & (keep if k % BEATS == BEATS - 1 else -1) for k, word in enumerate(words)]


@pytest.mark.parametrize("void", [0, 3])
@pytest.mark.parametrize(("rest", "stall"), [(0, 0), (0.3, 0.5)])
def test_packets_without_resets(void, rest, stall):
    dut = PacketPort(ROWS, BEATS, OCTETS, void_octets=void)
    packets, records, _ = run(dut, rest=rest, stall=stall, cut=0, seed=1)
    assert len(packets) > CLOCKS // 150
    for number, packet in enumerate(packets, FIRST):
        assert packet == image(number, FRAME, void) + trailer(dut, records[number])


@pytest.mark.parametrize(("seed", "void", "rest"), [(1, 0, 0.2), (2, 3, 0.2), (3, 0, 0.6), (4, 3, 0.6)])
def test_packets_stay_whole_when_their_sources_are_reset(seed, void, rest):
    dut = PacketPort(ROWS, BEATS, OCTETS, void_octets=void)
    packets, records, fate = run(dut, rest=rest, stall=0.4, cut=0.03, seed=seed, clocks=5000)
    found = {}
    for packet in packets:
        # No void byte makes a word zero: its lowest byte counts the beats of the frame.
        number, beats = packet[0] // 64, sum(word != 0 for word in packet[:FRAME])
        assert packet[:FRAME] == image(number, beats, void)
        whole = beats == FRAME and packet[FRAME:] == trailer(dut, records[number])
        assert whole or packet[FRAME:] == trailer(dut, ABORTED)
        assert number not in found
        found[number] = "whole" if whole else "aborted"
    assert list(found) == sorted(found)
    assert found.items() <= fate.items()
    assert len(fate) - len(found) <= 1
    assert min(list(found.values()).count(kind) for kind in ("whole", "aborted")) > 20


def test_the_trailer_follows_at_once_where_the_record_is_known():
    dut = PacketPort(1, 2, 64)
    seen = []

    async def bench(ctx):
        ctx.set(dut.port.tready, 1)
        ctx.set(dut.i.valid, 1)
        ctx.set(dut.record.valid, 1)
        for _ in range(9):
            seen.append((ctx.get(dut.port.tvalid), ctx.get(dut.port.tlast)))
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    assert seen == [(1, 0), (1, 0), (1, 1)] * 3


def test_the_record_of_a_cut_packet():
    record = PLAIN.layout
    found = np.frombuffer(ABORTED.to_bytes(RECORD_BYTES, "little"), record)[0]
    assert found["flags"] == 0b10001 | 1 << 8
    assert sum(int(found[name]) != 0 for name in record.names) == 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rows": 0}, "rows 0: expected at least 1"),
        ({"beats": 0}, "beats 0: expected at least 1"),
        ({"octets": 0}, "octets 0: expected at least 1"),
        ({"void_octets": 4}, "void_octets 4: expected 0 to 3"),
    ],
)
def test_invalid_arguments(changed, message):
    with pytest.raises(ValueError, match=message):
        PacketPort(**({"rows": 3, "beats": 4, "octets": 4} | changed))
