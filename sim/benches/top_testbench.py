"""Testbench of the top level in which a host acts between and inside frames; its tests are in other modules.

Reads two files in the folder BENCH: `settings.json`, and `frames.npz` with every image that reaches the pixel
network and the golden model's outputs for it. Frames are named by their index in it.
"""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, RisingEdge

from fastac.gateware.bus.register_map import ERRORS
from fastac.models.integer.frame_validity import suspects
from fastac.sim.benches.top import FOLDER, LINGER, SETTINGS, frame_beats, start

with np.load(FOLDER / "frames.npz", allow_pickle=False) as archive:
    FRAMES = {name: archive[name] for name in archive.files}
HEIGHT, WIDTH = FRAMES["frames"].shape[1:3]
ROWS = {"normals": HEIGHT, "depth": HEIGHT - 2, "force_map": HEIGHT - 2}
COLUMNS = {"normals": WIDTH, "depth": WIDTH - 2, "force_map": WIDTH - 2}
LINE_BEATS = FRAMES["frames"].shape[2] // SETTINGS["lanes"]
FRAME_BEATS = FRAMES["frames"].shape[1] * LINE_BEATS
RESULT_VALID, LAST_FRAME_BAD, LAST_FRAME_SUSPECT, SLIPS = 2, 4, 16, 32
SLIP = "SLIP_SPREAD", "SLIP_DOTS"
BAD, SUSPECT = 1 << 1, 1 << 10
"""Bits of `tuser` in the streams of depth and force maps."""
MARKS = RESULT_VALID | LAST_FRAME_BAD | LAST_FRAME_SUSPECT | SLIPS
ENABLE, CAPTURE, SOFT_RESET, INTERRUPT = 1, 2, 4, 8
TEST = {"timeout_time": SETTINGS["timeout_cycles"] * SETTINGS["period_ps"], "timeout_unit": "ps"}
STALLS = [[0, 0], [0.3, 0.4]]
"""Probabilities of pauses, see `Streams`: none, and some on all streams."""


def error_bits(*names: str) -> int:
    """The value of the register ERRORS with these errors set."""
    return sum(1 << ERRORS.index(name) for name in names)


def frame_beats_of(*indices: int) -> list[tuple[int, int, int]]:
    """Input beats of the images with these indices."""
    return [beat for k in indices for beat in frame_beats(FRAMES["frames"][k], SETTINGS["lanes"])]


def beats_of(name: str) -> int:
    """Beats per frame of an output stream."""
    return ROWS[name] * -(-COLUMNS[name] // SETTINGS["lanes"])


class Testbench:
    """The hardware after reset with its streams and host, and a scoreboard for the outputs.

    Outputs are compared from the last call of `compare_from_here` on.
    """

    def __init__(self, dut, streams, host):
        self.dut, self.streams, self.host = dut, streams, host
        self.serving = None
        self.compare_from_here()

    @classmethod
    async def start(cls, dut, stall=(0, 0), *, serve_interrupts: bool = True) -> "Testbench":
        bench = cls(dut, *await start(dut, stall))
        if serve_interrupts:
            bench.serve_interrupts()
        return bench

    def serve_interrupts(self) -> None:
        self.serving = cocotb.start_soon(self.host.serve_interrupts())

    def compare_from_here(self) -> None:
        """Leave everything output so far out of later comparisons."""
        self.beats_before = {name: len(sink.cycles) for name, sink in self.streams.sinks.items()}
        self.results_before = len(self.host.forces)

    async def wait_until(self, condition) -> None:
        while not condition():
            await RisingEdge(self.dut.clk)

    async def send_only(self, beats: int) -> None:
        """Stop the driver after the first `beats` beats of its queue and wait until they are accepted."""
        self.streams.limit = beats
        await self.wait_until(lambda: len(self.streams.accepted_at) == beats)

    async def hard_reset(self) -> None:
        for sink in self.streams.sinks.values():
            sink.reset_expected = True
        self.dut.rst.value = 1
        await ClockCycles(self.dut.clk, 3)
        self.dut.rst.value = 0
        await self.expect_silence()
        await self.host.write("CONTROL", ENABLE | INTERRUPT)

    async def soft_reset(self) -> None:
        """By the host. Streams that nobody reads keep their offers; then every stream completes its frame."""
        await self.host.write("CONTROL", ENABLE | INTERRUPT | SOFT_RESET)
        await ClockCycles(self.dut.clk, LINGER)
        self.streams.blocked = False
        sinks, silent = self.streams.sinks, 0
        while silent < LINGER:
            await RisingEdge(self.dut.clk)
            silent = 0 if any(int(sink.valid.value) for sink in sinks.values()) else silent + 1
        for name in sinks:
            assert not self.beats_missing(name), f"{name}: a frame was left incomplete"

    async def expect_silence(self) -> None:
        """Assert that after a reset no output is valid before new input comes."""
        for _ in range(LINGER):
            await RisingEdge(self.dut.clk)
            assert not any(int(sink.valid.value) for sink in self.streams.sinks.values())
        for sink in self.streams.sinks.values():
            sink.reset_expected = False
        self.streams.blocked = False

    def beats_missing(self, name: str) -> int:
        """Beats until a stream's frame that has begun is complete."""
        return -len(self.streams.sinks[name].cycles) % beats_of(name)

    def check_stream(self, name: str, frames, bad, *, cut: str = "") -> int:
        """Compare a stream's words and markers with those of `frames`; returns the number of closing zeros.

        frames : indices of images; bad : for each, whether it is to be marked as bad
        cut : "hard": only the beginning came; "soft": the frame that was cut was closed with zeros
        """
        sink, rows, columns = self.streams.sinks[name], ROWS[name], COLUMNS[name]
        arrays = {k.removeprefix(f"{name}_"): v for k, v in sink.arrays(name).items()}
        found = arrays["words"].reshape(len(sink.cycles), SETTINGS["lanes"], -1)[self.beats_before[name] :]
        line = -(-columns // SETTINGS["lanes"])
        shape = (len(frames), rows, line)
        words = FRAMES[name][list(frames)].reshape(len(frames), rows, columns, -1)
        padding = line * SETTINGS["lanes"] - columns
        words = np.pad(words, ((0, 0), (0, 0), (0, padding), (0, 0))).reshape(-1, *found.shape[1:])
        here = np.pad(np.ones((*shape[:2], columns), bool), ((0, 0), (0, 0), (0, padding)))
        here = here.reshape(-1, SETTINGS["lanes"])
        last = np.zeros(shape, int)
        last[..., -1] = 1
        user = np.zeros(shape, int)
        user[:, 0, 0] = 1
        if name != "normals":
            user += BAD * np.array(bad, int).reshape(-1, 1, 1) + 4 * np.array(SETTINGS["row_order"])[:, None]
            user += SUSPECT * suspects(FRAMES["validity"][list(frames)])[:, None, None]
        expected = {"last": last.ravel(), "user": user.ravel()}
        closing = 0
        if cut:
            most = len(words) - (cut == "hard")
            assert 0 < len(found) <= most, f"{name}: {len(found)} beats, expected 1 to {most}"
            words, here = words[: len(found)], here[: len(found)]
            expected = {k: v[: len(found)] for k, v in expected.items()}
        if cut == "soft":
            values = found.any(axis=(1, 2)) if name == "normals" else arrays["user"][-len(found) :] & BAD == 0
            exact = np.flatnonzero(values)[-1] + 1
            closing, words[exact:] = len(found) - exact, 0
            assert not len(found) % beats_of(name), f"{name}: {len(found)} beats, not whole frames"
            if name != "normals":
                expected["user"][exact:] = expected["user"][exact:] & ~SUSPECT | BAD
        assert len(found) == len(words), f"{name}: {len(found)} beats, expected {len(words)}"
        wrong = np.argwhere((found != words).any(axis=2) & here)
        assert not len(wrong), f"{name}: {len(wrong)} values differ, the first in (beat, lane) {wrong[0]}"
        for k, values in expected.items():
            wrong = np.flatnonzero(arrays[k][self.beats_before[name] :] != values)
            assert not len(wrong), f"{name}.t{k}: {len(wrong)} differ, the first in beat {wrong[0]}"
        return closing

    async def expect_frames(self, frames, bad=None) -> None:
        """Wait for all outputs of `frames` (indices of images) and compare them, registers included."""
        bad = bad or [0] * len(frames)
        host, streams = self.host, self.streams
        full = {name: len(frames) * beats_of(name) for name in streams.sinks}
        wanted = len(frames) if self.serving else 0
        await self.wait_until(
            lambda: (
                len(streams.accepted_at) == len(streams.beats)
                and len(host.forces) - self.results_before >= wanted
                and all(len(s.cycles) - self.beats_before[n] >= full[n] for n, s in streams.sinks.items())
            )
        )
        await ClockCycles(self.dut.clk, LINGER)
        for name in streams.sinks:
            self.check_stream(name, frames, bad)
        if self.serving:
            forces = host.forces[self.results_before :]
            expected = FRAMES["force"][list(frames)].tolist() if SETTINGS["axes"] else [[]] * len(frames)
            assert forces == expected, f"forces {forces}, expected {expected}"
            words, validity = host.registers[self.results_before :], FRAMES["validity"][list(frames)].tolist()
            found = [word["FRAME_VALIDITY"] for word in words]
            assert found == validity, f"FRAME_VALIDITY {found}, expected {validity}"
            marks = [word["STATUS"] & MARKS for word in words]
            slip = {name: FRAMES[name][list(frames)].tolist() for name in SLIP if name in FRAMES}
            for name, values in slip.items():
                found = [word[name] for word in words]
                assert found == values, f"{name} {found}, expected {values}"
            if "half_widths" in FRAMES:
                names = [f"HALF_WIDTH_{axis.upper()}" for axis in SETTINGS["axes"]]
                found = [[word[f"{n}_HIGH"] << 32 | word[f"{n}_LOW"] for n in names] for word in words]
                values = FRAMES["half_widths"][list(frames)].tolist()
                assert found == values, f"half-widths {found}, expected {values}"
            slips = FRAMES["slipping"][list(frames)].tolist() if slip else [0] * len(frames)
            expected = [
                RESULT_VALID | LAST_FRAME_BAD * b | LAST_FRAME_SUSPECT * bool(flags) | SLIPS * slip
                for b, flags, slip in zip(bad, validity, slips, strict=True)
            ]
            assert marks == expected, f"STATUS {marks}, expected {expected}"
        assert not await host.read("STATUS") & ~MARKS, "frames are in flight"

    async def expect_registers(self, **registers: int) -> None:
        """Read the named registers and compare their values."""
        for name, value in registers.items():
            found = await self.host.read(name)
            assert found == value, f"{name}: {found:#x}, expected {value:#x}"
