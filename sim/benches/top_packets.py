"""cocotb testbench of the top level with packets: packets of the wrong length, soft and hard resets, blocked
outputs.

Settings and frames are in the folder BENCH, as for top_faults.py; tests/gateware/test_top_packets.py makes
them."""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, RisingEdge

from fastac.gateware.bus.record import FORMAT_LOW, PLAIN, RecordFlag, record_form
from fastac.gateware.bus.register_map import ERRORS
from fastac.sim.benches.top import FOLDER, LINGER, SETTINGS, frame_words, start
from fastac.sim.check_packets import records_of

with np.load(FOLDER / "frames.npz", allow_pickle=False) as archive:
    FRAMES = {name: archive[name] for name in archive.files}
FRAME_BEATS = FRAMES["frames"].shape[1] * FRAMES["frames"].shape[2] // SETTINGS["lanes"]
ENABLE, SOFT_RESET, INTERRUPT, CLEAR_RESULTS = 1, 4, 8, 32
TEST = {"timeout_time": SETTINGS["timeout_cycles"] * SETTINGS["period_ps"], "timeout_unit": "ps"}
STALLS = [[0, 0], [0.3, 0.4]]
FORM = record_form(SETTINGS["record_words"] != len(PLAIN.words))
ABORTED = int(RecordFlag.BAD | RecordFlag.ABORTED) | FORM.number << FORMAT_LOW


def packet(frame: int, beats: int | None = None) -> list[tuple[int, int, int]]:
    """A frame's packet, or one with just so many of its beats, the first ones again after the last one."""
    words = frame_words(FRAMES["frames"][frame], SETTINGS["lanes"])
    count = len(words) if beats is None else beats
    return [(words[k % len(words)], int(k == count - 1), 0) for k in range(count)]


class Bench:
    """The hardware after reset, its streams and host; packets are compared from the last `forget` on."""

    def __init__(self, dut, streams, host):
        self.dut, self.streams, self.host, self.number = dut, streams, host, 0
        self.forget()

    @classmethod
    async def start(cls, dut, stall=(0, 0)) -> "Bench":
        return cls(dut, *await start(dut, stall))

    def forget(self) -> None:
        self.before = {name: len(sink.data) for name, sink in self.streams.sinks.items()}

    def packets(self, name: str) -> int:
        """Whole packets of a stream since `forget`."""
        return (len(self.streams.sinks[name].data) - self.before[name]) // SETTINGS["packet_bytes"][name]

    async def wait_until(self, condition) -> None:
        while not condition():
            await RisingEdge(self.dut.clk)

    async def accepted(self, beats: int) -> None:
        self.streams.limit = beats
        await self.wait_until(lambda: len(self.streams.accepted_at) == beats)

    async def expect(self, frames: list[int], bad: list[int]) -> None:
        """These frames' packets come, marked so, with numbers that go on, and nothing else."""
        names = list(self.streams.sinks)
        await self.wait_until(lambda: all(self.packets(name) >= len(frames) for name in names))
        await ClockCycles(self.dut.clk, LINGER)
        numbers = self.number + 1 + np.arange(len(frames))
        for name in names:
            self.check(name, frames, bad, numbers)
        self.number += len(frames)
        self.forget()

    def words(self, name: str) -> np.ndarray:
        """(packets, words) since `forget`; asserts that the last one is whole."""
        data = bytes(self.streams.sinks[name].data[self.before[name] :])
        assert len(data) % SETTINGS["packet_bytes"][name] == 0, f"{name}: a packet is incomplete"
        return np.frombuffer(data, "<i4").reshape(-1, SETTINGS["packet_bytes"][name] // 4)

    def check(self, name: str, frames, bad, numbers) -> None:
        words, image = self.words(name), SETTINGS["image_bytes"].get(name, 0) // 4
        assert len(words) == len(frames), f"{name}: {len(words)} packets for {len(frames)} frames"
        if image:
            assert np.array_equal(words[:, :image], FRAMES[f"{name}_image"][frames]), name
        records, _ = records_of(words.ravel(), words.shape[1], image, FORM)
        assert records["frame"].tolist() == list(numbers), name
        assert (records["flags"] & RecordFlag.BAD).tolist() == list(bad), name
        if SETTINGS["complete"].get(name, True):
            assert np.array_equal(records["validity"], FRAMES["validity"][frames]), name
            for k, axis in enumerate(SETTINGS["axes"]):
                assert np.array_equal(records[f"force_{axis}"], FRAMES["force"][frames, k]), name
                if "half_widths" in FRAMES:
                    halves = FRAMES["half_widths"][frames, k]
                    assert np.array_equal(records[f"half_width_{axis}"], halves), name

    async def expect_registers(self, **values: int) -> None:
        found = {name: await self.host.read(name) for name in values}
        assert found == values

    async def soft_reset(self) -> None:
        """Then streams that nobody read are read again, and every packet that was open is completed."""
        await self.host.write("CONTROL", ENABLE | INTERRUPT | SOFT_RESET)
        await ClockCycles(self.dut.clk, LINGER)
        self.streams.blocked = False
        silent = 0
        while silent < LINGER:
            await RisingEdge(self.dut.clk)
            valid = any(int(sink.valid.value) for sink in self.streams.sinks.values())
            silent = 0 if valid else silent + 1


def error_bits(*names: str) -> int:
    return sum(1 << ERRORS.index(name) for name in names)


@cocotb.test(**TEST)
@cocotb.parametrize(scenario=list(SETTINGS["scenarios"]), stall=STALLS)
async def packets_of_the_wrong_length(dut, scenario, stall):
    """A faulty frame is repaired, marked as bad and reported once; the frames around it are unchanged."""
    bench, scene = await Bench.start(dut, stall), SETTINGS["scenarios"][scenario]
    bench.streams.beats += [beat for frame, beats in scene["packets"] for beat in packet(frame, beats)]
    await bench.expect(scene["frames"], scene["bad"])
    await bench.expect_registers(FRAME_COUNT=len(scene["frames"]), FRAME_ERRORS=sum(scene["bad"]))
    errors = await bench.host.read("ERRORS")
    assert errors & ~error_bits("result_overrun", "frame_suspect", *SETTINGS["saturations"]) == error_bits(
        *scene["errors"]
    )


@cocotb.test(**TEST)
@cocotb.parametrize(
    cut=[1, FRAME_BEATS // 2, FRAME_BEATS - 1], blocked=[False, True], stall=STALLS, ahead=[0, 1]
)
async def soft_reset_inside_a_packet(dut, cut, blocked, stall, ahead):
    """Every open packet is completed; the rest of the input's packet is dropped, and the next frame is
    exact."""
    bench = await Bench.start(dut, stall)
    bench.streams.beats += [beat for frame in (0, 1, 2) for beat in packet(frame)]
    await bench.accepted(2 * FRAME_BEATS + cut)
    if ahead:  # while the first packet leaves, or its trailer waits
        name = next(iter(bench.streams.sinks))
        least = bench.before[name] + SETTINGS["image_bytes"].get(name, 0) // 2
        await bench.wait_until(lambda: len(bench.streams.sinks[name].data) > least)
    bench.streams.blocked = blocked
    await bench.soft_reset()
    bench.number = await bench.host.read("FRAME_COUNT")
    await bench.expect_registers(STATUS=0)
    for name in bench.streams.sinks:
        words, image = bench.words(name), SETTINGS["image_bytes"].get(name, 0) // 4
        records, _ = records_of(words.ravel(), words.shape[1], image, FORM)
        for k, found in enumerate(words):
            if records["flags"][k] == ABORTED:
                assert k == len(words) - 1, f"{name}: more than one packet was cut"
                sent = int(np.flatnonzero(found[:image]).max(initial=-1)) + 1
                assert np.array_equal(found[:sent], FRAMES[f"{name}_image"][k][:sent]), name
            else:
                assert records["frame"][k] == k + 1, name
                if image:
                    assert np.array_equal(found[:image], FRAMES[f"{name}_image"][k]), name
    bench.forget()
    await bench.host.write("ERRORS", 0xFFFF)
    bench.streams.beats += [beat for frame in (3, 4) for beat in packet(frame)]
    bench.streams.limit = len(bench.streams.beats)
    await bench.expect([3, 4], [0, 0])
    await bench.expect_registers(FRAME_ERRORS=0)
    known = error_bits("no_start", "result_overrun", "frame_suspect", *SETTINGS["saturations"])
    assert not await bench.host.read("ERRORS") & ~known


@cocotb.test(**TEST)
async def hard_reset_inside_a_packet(dut):
    """What remains of the packet looks like a short one, and is flagged so."""
    bench = await Bench.start(dut)
    for sink in bench.streams.sinks.values():
        sink.reset_expected = True
    cut = FRAME_BEATS // 2 + 1
    bench.streams.beats += [beat for frame in (0, SETTINGS["remainder"]) for beat in packet(frame)]
    await bench.accepted(FRAME_BEATS + cut)
    dut.rst.value = 1
    await ClockCycles(dut.clk, 3)
    dut.rst.value = 0
    await ClockCycles(dut.clk, LINGER)
    for sink in bench.streams.sinks.values():
        sink.reset_expected = False
    bench.forget()
    await bench.host.write("CONTROL", ENABLE | INTERRUPT)
    bench.streams.beats += packet(4)
    bench.streams.limit = len(bench.streams.beats)
    await bench.expect([SETTINGS["remainder_repaired"], 4], [1, 0])
    await bench.expect_registers(FRAME_COUNT=2, FRAME_ERRORS=1)
    assert await bench.host.read("ERRORS") & error_bits("frame_short")


@cocotb.test(**TEST)
async def outputs_that_are_not_read_lose_nothing(dut):
    """Frames wait at the input; records of the register FIFO that find no place are counted and flagged."""
    bench, frames = await Bench.start(dut), [k % 5 for k in range(20)]
    bench.streams.blocked = True
    bench.streams.beats += [beat for frame in frames for beat in packet(frame)]
    await ClockCycles(dut.clk, 12 * FRAME_BEATS)
    assert len(bench.streams.accepted_at) < 12 * FRAME_BEATS
    bench.streams.blocked = False
    await bench.expect(frames, [0] * len(frames))
    await bench.expect_registers(RESULTS_WAITING=16, RESULTS_LOST=4)
    assert await bench.host.read("ERRORS") & error_bits("results_lost")
    words = await bench.host.records()
    assert words[:: SETTINGS["record_words"]] == list(range(1, 17))
    await bench.host.write("CONTROL", ENABLE | INTERRUPT | CLEAR_RESULTS)
    await bench.expect_registers(RESULTS_WAITING=0, RESULTS_WORD=0)


@cocotb.test(**TEST)
async def a_dma_that_stops_inside_a_packet(dut):
    """The frame is completed after FRAME_TIMEOUT; late beats are dropped, and the next packet is exact."""
    bench = await Bench.start(dut)
    await bench.host.write("FRAME_TIMEOUT", 300)
    scene = SETTINGS["stops"]
    bench.streams.beats += packet(0)
    await bench.accepted(scene["beats"])
    await bench.expect([scene["frame"]], [1])
    bench.streams.beats += packet(1)
    bench.streams.limit = len(bench.streams.beats)
    await bench.expect([1], [0])
    assert await bench.host.read("ERRORS") & error_bits("frame_timeout")
