"""cocotb bench of the whole hardware when things go wrong, and of what a host can tell it to do.

Settings are in the folder BENCH: `settings.json`, and in `frames.npz` every image that reaches the pixel
network, good or repaired, with what the integer reference makes of it. See tests/gateware/test_top_zynq.py.
"""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, RisingEdge

from gateware.register_map import ERRORS
from sim.bench_top import FOLDER, LINGER, SET, frame_beats, start

with np.load(FOLDER / "frames.npz", allow_pickle=False) as archive:
    FRAMES = {name: archive[name] for name in archive.files}
HEIGHT, WIDTH = FRAMES["frames"].shape[1:3]
ROWS = {"normals": HEIGHT, "depth": HEIGHT - 2, "force_map": HEIGHT - 2}
COLUMNS = {"normals": WIDTH, "depth": WIDTH - 2, "force_map": WIDTH - 2}
LINE_BEATS = FRAMES["frames"].shape[2] // SET["lanes"]
FRAME_BEATS = FRAMES["frames"].shape[1] * LINE_BEATS
RESULT_VALID, LAST_FRAME_BAD = 2, 4
ENABLE, CAPTURE, SOFT_RESET, INTERRUPT = 1, 2, 4, 8
TEST = {"timeout_time": SET["timeout_cycles"] * SET["period_ps"], "timeout_unit": "ps"}
STALLS = [[0, 0], [0.3, 0.4]]


def flags(*names: str) -> int:
    return sum(1 << ERRORS.index(name) for name in names)


def beats(*indices: int) -> list[tuple[int, int, int]]:
    return [beat for k in indices for beat in frame_beats(FRAMES["frames"][k], SET["lanes"])]


def line(frame: int, row: int, length: int, last: int, first: int) -> list[tuple[int, int, int]]:
    """`length` beats from a row of an image on, with or without an end of line and a start of frame."""
    begin = row * LINE_BEATS
    words = [word for word, *_ in beats(frame)][begin : begin + length]
    return [(word, last * (k == length - 1), first * (k == 0)) for k, word in enumerate(words)]


class Run:
    """The hardware from reset on, and where in what came out the comparison begins."""

    def __init__(self, dut, streams, host):
        self.dut, self.streams, self.host = dut, streams, host
        self.serving = None
        self.mark()

    @classmethod
    async def begin(cls, dut, stall=(0, 0), *, serve: bool = True) -> "Run":
        run = cls(dut, *await start(dut, stall))
        if serve:
            run.serve()
        return run

    def serve(self) -> None:
        self.serving = cocotb.start_soon(self.host.serve())

    def mark(self) -> None:
        """What came so far is not compared."""
        self.since = {name: len(sink.at) for name, sink in self.streams.sinks.items()}
        self.results_since = len(self.host.forces)

    async def until(self, condition) -> None:
        while not condition():
            await RisingEdge(self.dut.clk)

    async def taken(self, beats: int) -> None:
        """Send so many beats in all, no more, and wait until the hardware has them."""
        self.streams.limit = beats
        await self.until(lambda: len(self.streams.taken_at) == beats)

    async def hard_reset(self) -> None:
        for sink in self.streams.sinks.values():
            sink.lenient = True
        self.dut.rst.value = 1
        await ClockCycles(self.dut.clk, 3)
        self.dut.rst.value = 0
        await self.settle()
        await self.host.write("CONTROL", ENABLE | INTERRUPT)

    async def soft_reset(self) -> None:
        for sink in self.streams.sinks.values():
            sink.lenient = True
        await self.host.write("CONTROL", ENABLE | INTERRUPT | SOFT_RESET)
        await self.settle()

    async def settle(self) -> None:
        """After a reset nothing is offered until something new comes in."""
        for _ in range(LINGER):
            await RisingEdge(self.dut.clk)
            assert not any(int(sink.valid.value) for sink in self.streams.sinks.values())
        for sink in self.streams.sinks.values():
            sink.lenient = False
        self.streams.closed = False

    def check(self, name: str, frames, bad, *, prefix: bool = False) -> None:
        """Words and markers of a stream since the mark; `prefix`: the beginning of what `frames` give."""
        sink, rows, columns = self.streams.sinks[name], ROWS[name], COLUMNS[name]
        arrays = {k.removeprefix(f"{name}_"): v for k, v in sink.arrays(name).items()}
        found = arrays["words"].reshape(len(sink.at), SET["lanes"], -1)[self.since[name] :]
        line = -(-columns // SET["lanes"])
        shape = (len(frames), rows, line)
        words = FRAMES[name][list(frames)].reshape(len(frames), rows, columns, -1)
        padding = line * SET["lanes"] - columns
        words = np.pad(words, ((0, 0), (0, 0), (0, padding), (0, 0))).reshape(-1, *found.shape[1:])
        here = np.pad(np.ones((*shape[:2], columns), bool), ((0, 0), (0, 0), (0, padding)))
        here = here.reshape(-1, SET["lanes"])
        last = np.zeros(shape, int)
        last[..., -1] = 1
        user = np.zeros(shape, int)
        user[:, 0, 0] = 1
        if name != "normals":
            user += 2 * np.array(bad, int).reshape(-1, 1, 1) + 4 * np.array(SET["row_order"])[:, None]
        expected = {"last": last.ravel(), "user": user.ravel()}
        if prefix:
            assert 0 < len(found) < len(words), f"{name}: {len(found)} beats are no part of {len(words)}"
            words, here = words[: len(found)], here[: len(found)]
            expected = {k: v[: len(found)] for k, v in expected.items()}
        assert len(found) == len(words), f"{name}: {len(found)} beats, expected {len(words)}"
        wrong = np.argwhere((found != words).any(axis=2) & here)
        assert not len(wrong), f"{name}: {len(wrong)} values differ, the first in (beat, lane) {wrong[0]}"
        for k, values in expected.items():
            wrong = np.flatnonzero(arrays[k][self.since[name] :] != values)
            assert not len(wrong), f"{name}.t{k}: {len(wrong)} differ, the first in beat {wrong[0]}"

    async def finish(self, frames, bad=None) -> None:
        """Wait for everything that `frames` (indices) give since the mark, and compare it all."""
        bad = bad or [0] * len(frames)
        host, streams = self.host, self.streams
        full = {name: len(frames) * ROWS[name] * -(-COLUMNS[name] // SET["lanes"]) for name in streams.sinks}
        wanted = len(frames) if self.serving else 0
        await self.until(
            lambda: (
                len(streams.taken_at) == len(streams.beats)
                and len(host.forces) - self.results_since >= wanted
                and all(len(s.at) - self.since[n] >= full[n] for n, s in streams.sinks.items())
            )
        )
        await ClockCycles(self.dut.clk, LINGER)
        for name in streams.sinks:
            self.check(name, frames, bad)
        if self.serving:
            forces = host.forces[self.results_since :]
            expected = FRAMES["force"][list(frames)].tolist() if SET["axes"] else [[]] * len(frames)
            assert forces == expected, f"forces {forces}, expected {expected}"
            marks = [word["STATUS"] for word in host.registers[self.results_since :]]
            marks = [mark & (RESULT_VALID | LAST_FRAME_BAD) for mark in marks]
            assert marks == [RESULT_VALID | LAST_FRAME_BAD * b for b in bad], f"STATUS {marks}"
        assert not await host.read("STATUS") & ~(RESULT_VALID | LAST_FRAME_BAD), "frames are in flight"

    async def expect(self, **registers: int) -> None:
        for name, value in registers.items():
            found = await self.host.read(name)
            assert found == value, f"{name}: {found:#x}, expected {value:#x}"


@cocotb.test(**TEST)
@cocotb.parametrize(scenario=list(SET["scenarios"]), stall=STALLS)
async def bad_input(dut, scenario, stall):
    """Repaired and marked, reported once, and the frames around it are as if nothing had been."""
    dut._log.info("scenario %s", scenario)
    run, scene = await Run.begin(dut, stall), SET["scenarios"][scenario]
    run.streams.beats += [beat for each in scene["lines"] for beat in line(*each)]
    await run.finish(scene["frames"], scene["bad"])
    await run.expect(FRAME_COUNT=len(scene["frames"]), FRAME_ERRORS=sum(scene["bad"]))
    errors = flags(*scene["errors"])
    await run.expect(ERRORS=errors)
    await run.host.write("ERRORS", ~errors & 0xFFFFFFFF)
    await run.expect(ERRORS=errors)
    await run.host.write("ERRORS", errors)
    await run.expect(ERRORS=0)


@cocotb.test(**TEST)
@cocotb.parametrize(
    kind=["hard", "soft"], cut=[1, FRAME_BEATS // 2, FRAME_BEATS - 1], closed=[False, True], stall=STALLS
)
async def reset_inside_a_frame(dut, kind, cut, closed, stall):
    """The output streams are inside a frame too; with `closed`, an offer may wait there."""
    run = await Run.begin(dut, stall, serve=False)
    run.streams.beats += beats(0, 1, 2, 3, 4)
    await run.taken(2 * FRAME_BEATS + cut)
    sinks = run.streams.sinks
    name = next((name for name in ("depth", "normals") if name in sinks), None)
    if name is not None:
        row = -(-COLUMNS[name] // SET["lanes"])
        enough = 5 * row + row // 2 if name == "depth" else 2 * FRAME_BEATS + 1
        await run.until(lambda: len(sinks[name].at) >= enough)
    run.streams.closed = closed
    if closed and name == "depth":
        await run.until(lambda: int(sinks[name].valid.value))
    await (run.hard_reset if kind == "hard" else run.soft_reset)()
    before = 0 if kind == "hard" else 2
    await run.expect(STATUS=0, FRAME_COUNT=before)
    for each in sinks:
        run.check(each, [0, 1, 2], [0, 0, 0], prefix=True)
    run.mark()
    await run.host.write("INTERRUPT_STATUS", 1)
    run.serve()
    run.streams.limit = len(run.streams.beats)
    await run.finish([3, 4])
    await run.expect(FRAME_COUNT=before + 2, FRAME_ERRORS=0)
    assert await run.host.read("ERRORS") & ~flags("result_overrun") == flags("no_start")


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS)
async def background_capture(dut, stall):
    """The frame after the one in which it is asked for; it outlives both resets."""
    captured, after = SET["captured"], SET["after_capture"]
    run = await Run.begin(dut, stall)
    run.streams.beats += beats(0, captured, *after)
    await run.taken(FRAME_BEATS // 2)
    await run.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    await run.expect(CONTROL=ENABLE | INTERRUPT | CAPTURE)
    run.streams.limit = len(run.streams.beats)
    await run.finish([0, captured, *after])
    await run.expect(CONTROL=ENABLE | INTERRUPT, ERRORS=0)
    for reset in (run.soft_reset, run.hard_reset):
        await reset()
        run.mark()
        run.streams.beats += beats(*after)
        run.streams.limit = len(run.streams.beats)
        await run.finish(after)
    # And the next test: bring the bundle's background back.
    run.mark()
    await run.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    run.streams.beats += beats(SET["background"], 0)
    run.streams.limit = len(run.streams.beats)
    await run.finish([SET["background"], 0])


@cocotb.test(**TEST)
async def saturation_is_reported(dut):
    run = await Run.begin(dut)
    for frame, errors in SET["saturating"]:
        run.streams.beats += beats(frame)
        await run.finish([frame])
        await run.expect(ERRORS=flags(*errors))
        # A frame without leaves it as it is; one bit of two can be cleared.
        run.mark()
        run.streams.beats += beats(0)
        await run.finish([0])
        await run.expect(ERRORS=flags(*errors))
        for k, name in enumerate(errors):
            await run.host.write("ERRORS", flags(name))
            await run.expect(ERRORS=flags(*errors[k + 1 :]))
        run.mark()


@cocotb.test(**TEST)
async def interrupt_on_and_off(dut):
    run = await Run.begin(dut, serve=False)
    host = run.host
    await host.write("CONTROL", ENABLE)
    run.streams.beats += beats(0)
    await run.finish([0])
    await run.expect(INTERRUPT_STATUS=1, ERRORS=0)
    assert not int(dut.interrupt.value)
    await host.write("CONTROL", ENABLE | INTERRUPT)
    await RisingEdge(dut.clk)
    assert int(dut.interrupt.value)
    await host.write("INTERRUPT_STATUS", 1)
    await RisingEdge(dut.clk)
    assert not int(dut.interrupt.value)
    await run.expect(INTERRUPT_STATUS=0)
    # Nobody acknowledges the next two.
    run.mark()
    run.streams.beats += beats(1, 0)
    await run.finish([1, 0])
    await run.expect(INTERRUPT_STATUS=1, ERRORS=flags("result_overrun"))
    assert int(dut.interrupt.value)
    await host.write("INTERRUPT_STATUS", 1)
    await host.write("ERRORS", 0xFF)
    await run.expect(INTERRUPT_STATUS=0, ERRORS=0)
    await RisingEdge(dut.clk)
    assert not int(dut.interrupt.value)


@cocotb.test(**TEST)
async def frames_are_dropped_while_disabled(dut):
    run = await Run.begin(dut)
    await run.host.write("CONTROL", INTERRUPT)
    run.streams.beats += beats(0, 1)
    await run.taken(2 * FRAME_BEATS - 1)
    # Enabled inside a frame: from the next one on.
    await run.host.write("CONTROL", ENABLE | INTERRUPT)
    run.streams.beats += beats(2)
    run.streams.limit = len(run.streams.beats)
    await run.finish([2])
    await run.expect(FRAME_COUNT=1, FRAME_ERRORS=0, ERRORS=0)
