# amaranth: UnusedElaboratable=no
"""PacketInput in front of FrameGuard, with packets of any length, against the plain loops of both."""

import random
from itertools import pairwise

import pytest
from amaranth import Module, ResetInserter, Signal
from amaranth.lib import wiring
from amaranth.sim import Simulator

from fastac.gateware.packet_format import FrameFormat
from fastac.gateware.packets.packet_input import PacketInput
from fastac.gateware.stream.frame_guard import FRAME_FAULTS, FrameGuard
from fastac.sim.faults.packet_rules import PacketRules
from tests.gateware.stream.test_frame_guard import reference

FRAME = FrameFormat(height=3, width=8, channels=3, lanes=2)
LINE, BEATS = 4, 12


def chain(dut: PacketInput, guard: FrameGuard) -> tuple[Module, Signal]:
    """Both as in the top level, and the soft reset, which only the guard has."""
    m, reset = Module(), Signal()
    m.submodules.entry, m.submodules.guard = dut, ResetInserter(reset)(guard)
    wiring.connect(m, dut.o, guard.axis)
    m.d.comb += [guard.enable.eq(dut.o_enable), guard.tag.ready.eq(1)]
    return m, reset


def without_padding(word: int) -> int:
    """The bits of two pixels of three channels, of which each has a byte of padding."""
    return word & 0xFFFFFF | (word >> 32 & 0xFFFFFF) << 24


class Run:
    """What went in and came out, beat by beat.

    entered : (tdata, tlast, enable) of each accepted beat; accepted_at : their clocks
    left : words; left_at : their clocks; flags : pulses of each fault; bad : tags

    rest, stall : probabilities per clock that no beat is offered, and that the guard's output is not ready
    reset_at : number of accepted beats after which the guard is reset for one clock
    """

    def __init__(self, packets, *, pause=0, rest=0.0, stall=0.0, seed=1, reset_at=None, clocks=None):
        self.dut = PacketInput(FRAME, pause=pause)
        guard = FrameGuard(FRAME.height, FRAME.width, FRAME.channels, lanes=FRAME.lanes)
        m, reset = chain(self.dut, guard)
        rng = random.Random(seed)
        queue = [(*beat, packet[1]) for packet in packets for beat in self._beats(packet[0], rng)]
        self.entered, self.accepted_at, self.left, self.left_at, self.bad = [], [], [], [], []
        self.flags = dict.fromkeys((*FRAME_FAULTS, "frame_started", "frame_done"), 0)
        clocks = clocks or 20 * len(queue) + 200

        async def bench(ctx):
            offered, left_to_reset = False, reset_at is not None
            for clock in range(clocks):
                offered = offered or (bool(queue) and rng.random() >= rest)
                ctx.set(self.dut.axis.tvalid, offered)
                if offered:
                    word, last, enable = queue[0]
                    ctx.set(self.dut.axis.tdata, word)
                    ctx.set(self.dut.axis.tlast, last)
                    ctx.set(self.dut.axis.tkeep, rng.getrandbits(8))
                    ctx.set(self.dut.enable, enable)
                ctx.set(guard.o.ready, rng.random() >= stall)
                resets = left_to_reset and len(self.entered) == reset_at
                left_to_reset = left_to_reset and not resets
                ctx.set(reset, resets)
                taken = bool(offered and ctx.get(self.dut.axis.tready))
                assert ctx.get(self.dut.accepted) == taken
                if taken:
                    self.entered.append(queue.pop(0))
                    self.accepted_at.append(clock)
                    offered = False
                if ctx.get(guard.o.valid) and ctx.get(guard.o.ready):
                    self.left.append(ctx.get(guard.o.payload.as_value()))
                    self.left_at.append(clock)
                if ctx.get(guard.tag.valid):
                    self.bad.append(ctx.get(guard.tag.payload))
                for name in self.flags:
                    self.flags[name] += ctx.get(getattr(guard, name))
                await ctx.tick()

        simulator = Simulator(m)
        simulator.add_clock(1e-8)
        simulator.add_testbench(bench)
        simulator.run()
        assert not queue, "a beat was never taken"

    @staticmethod
    def _beats(length, rng):
        return [(rng.getrandbits(64), int(k == length - 1)) for k in range(length)]

    def expected(self):
        """(Words, tags, flags) by the golden models of both components."""
        rules, video = PacketRules(FRAME.height, LINE), []
        for index, (word, last, enable) in enumerate(self.entered):
            for mark in rules.beat(index, last=bool(last)):
                made_up = mark.index is None
                data = 0 if made_up else without_padding(word)
                video.append((data, int(mark.last), int(mark.start), int(enable and not made_up)))
        return reference(video, FRAME.height, LINE, FRAME.lanes, 8 * FRAME.channels)


GOOD = (BEATS, 1)
CASES = {
    "whole frames": ([GOOD] * 3, {}),
    "inside a line": ([GOOD, (6, 1), GOOD], {"line_short": 1, "frame_short": 1}),
    "at the end of a line": ([GOOD, (2 * LINE, 1), GOOD], {"frame_short": 1}),
    "inside the last line": ([GOOD, (BEATS - 1, 1), GOOD], {"line_short": 1}),
    "one beat": ([GOOD, (1, 1), GOOD], {"line_short": 1, "frame_short": 1}),
    "one beat first": ([(1, 1), GOOD], {"line_short": 1, "frame_short": 1}),
    "one beat too many": ([GOOD, (BEATS + 1, 1), GOOD], {"frame_long": 1}),
    "two frames in one": ([(2 * BEATS, 1), GOOD], {"frame_long": 1}),
    "short, then long": (
        [(3, 1), (BEATS + 5, 1), GOOD],
        {"line_short": 1, "frame_short": 1, "frame_long": 1},
    ),
    "disabled": ([GOOD, (BEATS, 0), (5, 0), (BEATS + 2, 0), GOOD], {}),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("stalls", [(0, 0), (0.3, 0.4)])
def test_packets_of_any_length(case, stalls):
    packets, faults = CASES[case]
    run = Run(packets, rest=stalls[0], stall=stalls[1])
    words, bad, flags = run.expected()
    assert run.left == words
    assert run.bad == bad
    assert run.flags == flags
    assert {name: flags[name] for name in FRAME_FAULTS if flags[name]} == faults
    assert run.left[-BEATS:] == [without_padding(word) for word, *_ in run.entered[-BEATS:]]


def test_random_packets():
    rng = random.Random(2)
    packets = []
    for _ in range(150):
        length = rng.choice([BEATS, BEATS, rng.randint(1, BEATS), rng.randint(BEATS, 3 * BEATS)])
        packets.append((length, int(rng.random() < 0.9)))
    run = Run([*packets, GOOD], pause=2, rest=0.2, stall=0.2)
    assert (run.left, run.bad, run.flags) == run.expected()


def test_a_short_packet_s_frame_is_complete_without_a_later_packet():
    run = Run([(2, 1)], clocks=40)
    assert len(run.left) == BEATS
    assert run.bad == [1]


@pytest.mark.parametrize("pause", [0, 3])
def test_pauses_and_latency(pause):
    run = Run([GOOD] * 4, pause=pause)
    first = run.accepted_at[::BEATS]
    assert [b - a for a, b in pairwise(first)] == [BEATS + pause] * 3
    assert [b - a for a, b in zip(run.accepted_at, run.left_at, strict=True)] == [2] * 4 * BEATS


@pytest.mark.parametrize("cut", [1, LINE, BEATS - 1])
def test_the_rest_of_a_packet_that_a_reset_has_cut_is_dropped(cut):
    run = Run([GOOD, GOOD, GOOD], rest=0.3, reset_at=BEATS + cut)
    assert run.left[-BEATS:] == [without_padding(word) for word, *_ in run.entered[-BEATS:]]
    assert run.flags["frame_done"] == 2
    assert run.bad[-1] == 0
    # After a reset `no_start` is told once, unless the packet's last beat was lost in the reset itself.
    assert {name: run.flags[name] for name in FRAME_FAULTS if run.flags[name]} in ({"no_start": 1}, {})


def test_invalid_arguments():
    with pytest.raises(ValueError, match="pause -1: expected at least 0"):
        PacketInput(FRAME, pause=-1)
