"""cocotb testbench of the fault campaign: faults one after the other at the ports of the whole hardware.

Settings, faults and the golden model's results are in the folder BENCH, where fastac/sim/faults/campaign.py
puts them; `records.json` with what was found, and `failure.json` after a failure, go there too.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import RisingEdge

from fastac.sim.benches.faults.engine import Engine
from fastac.sim.benches.faults.host import error_names

FOLDER = Path(os.environ["BENCH"])
SETTINGS = json.loads((FOLDER / "settings.json").read_text())
CLOCKS_PER_BEAT = 120
"""A fault and the good frames after it must be over within so many clocks for each beat of a whole frame.
Garbage can start dozens of frames, each of which is padded."""
CLOCKS = max(30_000, CLOCKS_PER_BEAT * SETTINGS["height"] * SETTINGS["line_beats"])
RESULT_VALID, LAST_FRAME_BAD, LAST_FRAME_SUSPECT = 2, 4, 16


class FrameResult(NamedTuple):
    """What the golden model says of a frame besides its images."""

    forces: list[int]
    validity: int
    suspect: bool
    errors: frozenset[str]


class Golden:
    """The golden model's results: arrays of `frames.npz`, one row a frame."""

    def __init__(self, path: Path):
        with np.load(path, allow_pickle=False) as archive:
            self.arrays = {name: archive[name] for name in archive.files}
        self._words: dict[tuple, list[int]] = {}

    def pixels(self, image: int, row: int, x: int) -> int:
        return int.from_bytes(self.arrays["bank"][image, row, x].tobytes(), "little")

    def words(self, calibration: str, stream: str, row: int) -> list[int]:
        """A frame's beats on an output stream, `tdata` of each."""
        key = (calibration, stream, row)
        if key not in self._words:
            beats = self.arrays[f"{calibration}/{stream}"][row]
            self._words[key] = [int.from_bytes(beat.tobytes(), "little") for beat in beats]
        return self._words[key]

    def result(self, calibration: str, row: int) -> FrameResult:
        part = {name: self.arrays[f"{calibration}/{name}"][row] for name in ("force", "validity", "suspect")}
        saturated = self.arrays[f"{calibration}/saturated"][row]
        errors = {name for name, seen in zip(SETTINGS["saturations"], saturated, strict=True) if seen}
        errors |= {"frame_suspect"} if part["validity"] else set()
        return FrameResult(
            part["force"].tolist(), int(part["validity"]), bool(part["suspect"]), frozenset(errors)
        )


def expected_result(frame) -> tuple[list[int], int, int]:
    """Forces, FRAME_VALIDITY and the marks of STATUS that the host reads for a frame."""
    marks = RESULT_VALID | LAST_FRAME_BAD * frame.bad | LAST_FRAME_SUSPECT * bool(frame.result.validity)
    return frame.result.forces, frame.result.validity, marks


class Checks:
    """What is compared when a fault and the good frames after it are over."""

    def __init__(self, engine: Engine):
        self.engine, self.host, self.results = engine, engine.host, 1

    def run(self):
        """The host's last program of a fault; raises AssertionError."""
        engine, host = self.engine, self.host
        frames = engine.rules.frames
        last = len(engine.beats) - engine.settings["height"] * engine.settings["line_beats"]
        assert frames, "the good frame did not start"
        assert (frames[-1].start, frames[-1].bad) == (last, False), "the last frame is not the good one"
        yield from host.wait_until_idle()
        yield from host.expect("STATUS", (yield from host.read("STATUS")) & 0b10110)
        count = yield from host.read("FRAME_COUNT")
        least, most = (base + len(frames) for base in engine.count)
        assert least <= count <= most, f"FRAME_COUNT {count}, expected {least} to {most}"
        bad = yield from host.read("FRAME_ERRORS")
        least, most = (base + sum(frame.bad for frame in frames) for base in engine.bad_count)
        assert least <= bad <= most, f"FRAME_ERRORS {bad}, expected {least} to {most}"
        number, *found = yield from host.result()
        expected = expected_result(frames[-1])
        assert tuple(found) == expected, f"last result {found}, expected {expected}"
        if engine.settings["axes"]:
            assert number == count, f"FORCE_SEQUENCE {number}, FRAME_COUNT {count}"
        self._check_samples(count)
        yield from self._check_errors()
        engine.count, engine.bad_count = (count, count), (bad, bad)

    def _check_samples(self, count: int) -> None:
        """The results that the host has read between, by the number of their frame."""
        engine = self.engine
        epochs = [*engine.epochs, [(count - len(engine.rules.frames),) * 2, engine.rules.frames]]
        for epoch, (number, *found) in engine.samples:
            (least, most), frames = epochs[epoch]
            if engine.settings["axes"] and least == most and number > least:
                expected = expected_result(frames[number - least - 1])
                assert tuple(found) == expected, f"result {number}: {found}, expected {expected}"
                self.results += 1

    def _check_errors(self):
        engine, host, rules = self.engine, self.host, self.engine.rules
        must, may = engine.flags | rules.flags, set(rules.possible)
        for frame in rules.frames:
            must |= frame.result.errors
        for _, frames in engine.epochs:
            may |= set().union(*(frame.result.errors for frame in frames if hasattr(frame, "result")))
        pending = yield from host.read("INTERRUPT_STATUS")
        if not engine.fault["serves"]:
            assert pending == 1, "INTERRUPT_STATUS is 0 after a result"
        if len(rules.frames) > 1 and not engine.fault["serves"]:
            must.add("result_overrun")
        elif engine.started > 1:
            may.add("result_overrun")
        value = yield from host.read("ERRORS")
        found = error_names(value)
        assert must <= found <= must | may, (
            f"ERRORS {sorted(found)}: must {sorted(must)}, may {sorted(may - must)}"
        )
        yield from host.write("ERRORS", value)
        yield from host.write("INTERRUPT_STATUS", 1)
        yield from host.expect("ERRORS", 0)
        self.errors = sorted(found)


async def play(engine: Engine, fault: dict, frames: dict) -> dict:
    """One fault and what follows it; returns what was seen. Raises AssertionError."""
    start, taken = engine.cycle, [stream.taken for stream in engine.streams]
    engine.begin_fault(fault, frames)
    while (
        engine.accepted < len(engine.beats) or engine.events.left or not engine.controlled or engine.programs
    ):
        await engine.clock()
        assert engine.cycle - start < CLOCKS, (
            f"stuck: {engine.accepted} of {len(engine.beats)} beats taken,"
            f" {len(engine.events.left)} events left"
        )
    checks = Checks(engine)
    engine.run(checks.run(), "control")
    while engine.programs or any(stream.expected for stream in engine.streams):
        await engine.clock()
        missing = {s.name: len(s.expected) for s in engine.streams if s.expected}
        assert engine.cycle - start < CLOCKS, f"stuck: beats missing of {missing}"
    return {
        "number": fault["number"],
        "kinds": fault["kinds"],
        "states": [engine.events.found.get(place) for place in range(len(fault["kinds"]))],
        "clocks": engine.cycle - start,
        "frames": len(engine.rules.frames),
        "bad": sum(frame.bad for frame in engine.rules.frames),
        "results": checks.results,
        "beats": sum(stream.taken for stream in engine.streams) - sum(taken),
        "errors": checks.errors,
        "slow_outputs": fault["slow_outputs"],
    }


@cocotb.test()
async def faults(dut):
    Clock(dut.clk, 10, unit="ns").start()
    content = json.loads((FOLDER / "faults.json").read_text())
    dut.rst.value = 1
    engine = Engine(dut, SETTINGS, Golden(FOLDER / "frames.npz"))
    await RisingEdge(dut.clk)
    engine.hard_reset(3)
    records = []
    while not engine.controlled or engine.programs or engine.reset_clocks:
        await engine.clock()
    for fault, frames in content:
        try:
            records.append(await play(engine, fault, frames))
        except Exception as error:
            states = [engine.events.found.get(place) for place in range(len(fault["kinds"]))]
            failure = {"number": fault["number"], "kinds": fault["kinds"], "states": states}
            failure |= {"clock": engine.cycle, "error": str(error) or repr(error)}
            (FOLDER / "failure.json").write_text(json.dumps(failure))
            raise
    (FOLDER / "records.json").write_text(json.dumps(records))
