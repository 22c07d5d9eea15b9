"""The whole hardware from reset on, for benches in which a host acts on it between and inside frames.

Settings are in the folder BENCH: `settings.json`, and in `frames.npz` every image that reaches the pixel
network with what the integer reference makes of it.
"""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, RisingEdge

from fastac.gateware.bus.register_map import ERRORS
from fastac.models.integer.frame_validity import suspects
from fastac.sim.benches.top import FOLDER, LINGER, SET, frame_beats, start

with np.load(FOLDER / "frames.npz", allow_pickle=False) as archive:
    FRAMES = {name: archive[name] for name in archive.files}
HEIGHT, WIDTH = FRAMES["frames"].shape[1:3]
ROWS = {"normals": HEIGHT, "depth": HEIGHT - 2, "force_map": HEIGHT - 2}
COLUMNS = {"normals": WIDTH, "depth": WIDTH - 2, "force_map": WIDTH - 2}
LINE_BEATS = FRAMES["frames"].shape[2] // SET["lanes"]
FRAME_BEATS = FRAMES["frames"].shape[1] * LINE_BEATS
RESULT_VALID, LAST_FRAME_BAD, LAST_FRAME_SUSPECT = 2, 4, 16
SUSPECT = 1 << 10
"""Of tuser, in streams of depth and force maps."""
MARKS = RESULT_VALID | LAST_FRAME_BAD | LAST_FRAME_SUSPECT
ENABLE, CAPTURE, SOFT_RESET, INTERRUPT = 1, 2, 4, 8
TEST = {"timeout_time": SET["timeout_cycles"] * SET["period_ps"], "timeout_unit": "ps"}
STALLS = [[0, 0], [0.3, 0.4]]


def flags(*names: str) -> int:
    return sum(1 << ERRORS.index(name) for name in names)


def beats(*indices: int) -> list[tuple[int, int, int]]:
    return [beat for k in indices for beat in frame_beats(FRAMES["frames"][k], SET["lanes"])]


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
            user += SUSPECT * suspects(FRAMES["validity"][list(frames)])[:, None, None]
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
            words, validity = host.registers[self.results_since :], FRAMES["validity"][list(frames)].tolist()
            found = [word["FRAME_VALIDITY"] for word in words]
            assert found == validity, f"FRAME_VALIDITY {found}, expected {validity}"
            marks = [word["STATUS"] & MARKS for word in words]
            expected = [
                RESULT_VALID | LAST_FRAME_BAD * b | LAST_FRAME_SUSPECT * bool(flags)
                for b, flags in zip(bad, validity, strict=True)
            ]
            assert marks == expected, f"STATUS {marks}, expected {expected}"
        assert not await host.read("STATUS") & ~MARKS, "frames are in flight"

    async def expect(self, **registers: int) -> None:
        for name, value in registers.items():
            found = await self.host.read(name)
            assert found == value, f"{name}: {found:#x}, expected {value:#x}"
