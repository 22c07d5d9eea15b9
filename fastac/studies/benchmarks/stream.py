"""What a stream costs: records a second, and the time from a frame to its record in another process.

    fastac bench stream BUILD_FOLDER…

Records of forces alone and records with arrays take turns, so that both meet the same disturbances. Frames
are the background with noise, and lie in memory.
"""

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import cycle, islice
from pathlib import Path

import numpy as np

from fastac.driver.driver import Driver
from fastac.driver.run import Stop
from fastac.driver.transports.emulator import EmulatorTransport
from fastac.models.integer.bundle import Bundle, load_bundle
from fastac.report.tables import text_table
from fastac.streaming import clock, producer
from fastac.streaming.record import StreamRecord, encode
from fastac.streaming.run import await_readers
from fastac.streaming.server import Publisher
from fastac.streaming.session import description_of
from fastac.studies.benchmarks.stream_reader import Reader

FRAMES, TURNS = 2000, 8
"""Frames of each kind of records whose latency is measured, and in how many turns."""
RATE_FRAMES, REPEATS = 400, 5
CAMERA_HZ = 240
KEPT = 24
NOISE = 12
"""Of the frames, in digital numbers, around the background: so much that they are judged, and not suspect."""
ARRAYS = ("depth_mm", "normals", "force_map_n")
QUANTILES = {"median": 0.5, "99%": 0.99, "99.9%": 0.999, "largest": 1.0}


class Kind:
    """Records with certain arrays: a driver on the emulator, a publisher, and a reader in another process."""

    def __init__(self, bundle: Bundle, folder: Path, arrays: tuple[str, ...]):
        self.arrays = arrays
        self.name = "force alone" if not arrays else ", ".join(("force", *arrays))
        self.description = description_of(bundle, folder / "verilog", needed=False)
        self.driver = Driver(EmulatorTransport(bundle, self.description), self.description)
        self.publisher = Publisher("tcp://127.0.0.1:*")
        facts = {"via": "emulator", "source": "noise", "frames_per_second": CAMERA_HZ}
        self.publisher.announce(producer.about(bundle.scene, self.description, arrays=arrays, **facts))
        self.reader = Reader(self.publisher.address)

    def records(self, frames: Iterable[np.ndarray], in_flight: int | None) -> Iterator[StreamRecord]:
        """Records whose time stamps are of the monotonic clock, when their frames were handed in."""
        stamped = clock.arriving(frames, time.monotonic_ns)
        return producer.records(self.driver, stamped, arrays=self.arrays, in_flight=in_flight)


@contextmanager
def served(bundle: Bundle, folder: Path) -> Iterator[list[Kind]]:
    """Records of forces alone, and those with arrays where the hardware has any; their readers are there."""
    with ExitStack() as stack:
        stop = stack.enter_context(Stop())
        kinds = [Kind(bundle, folder, ())]
        there = producer.available(kinds[0].description)
        if arrays := tuple(name for name in ARRAYS if name in there):
            kinds.append(Kind(bundle, folder, arrays))
        for kind in kinds:
            stack.callback(kind.publisher.close)
            await_readers(kind.publisher, 1, stop, progress=False)
        yield kinds


def noise(bundle: Bundle) -> np.ndarray:
    """Frames (KEPT, H, W, C) uint8."""
    background, rng = bundle.pipeline.background, np.random.default_rng(1)
    found = background + rng.integers(-NOISE, NOISE + 1, (KEPT, *background.shape))
    return np.clip(found, 0, 255).astype(np.uint8)


def camera(frames: np.ndarray) -> Iterator[np.ndarray]:
    """The frames over and over, at a camera's pace."""
    due = time.monotonic()
    for frame in cycle(frames):
        due = max(due + 1 / CAMERA_HZ, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
        yield frame


def rates(kinds: list[Kind], frames: np.ndarray) -> str:
    """A table of the records a second, in this process and published."""
    seconds = {(kind.name, served): float("inf") for kind in kinds for served in (False, True)}
    sizes = {}
    for _ in range(REPEATS):
        for kind in kinds:
            for served in (False, True):
                begun = time.perf_counter()
                for record in kind.records(islice(cycle(frames), RATE_FRAMES), None):
                    if served:
                        kind.publisher.add(record)
                taken = time.perf_counter() - begun
                seconds[kind.name, served] = min(seconds[kind.name, served], taken)
                sizes[kind.name] = sum(len(part) for part in encode(record))
    rows = []
    for kind in kinds:
        alone, served = (f"{RATE_FRAMES / seconds[kind.name, served]:.0f}" for served in (False, True))
        kind.publisher.close()
        got = f"{len(kind.reader.times()[0])} of {kind.publisher.sent}"
        rows.append([kind.name, f"{sizes[kind.name] / 1e3:.1f}", alone, served, got])
    return text_table(["records", "kB each", "a second", "a second, published", "read"], rows)


def latencies(kinds: list[Kind], frames: np.ndarray, count: int) -> str:
    """A table of the times from handing a frame in to having its record decoded in another process."""
    running = [kind.records(camera(frames), 1) for kind in kinds]
    for _ in range(TURNS):
        for kind, records in zip(kinds, running, strict=True):
            for record in islice(records, -(-count // TURNS)):
                kind.publisher.add(record)
    rows = []
    for kind, records in zip(kinds, running, strict=True):
        records.close()
        kind.publisher.close()
        times_s, missed = kind.reader.times()
        whole, driver = times_s.T
        for name, values in (("whole", whole), ("of it in the driver", driver), ("the rest", whole - driver)):
            found = [f"{1e3 * np.quantile(values, q):.3f}" for q in QUANTILES.values()]
            rows.append([kind.name, name, *found, f"{missed} of {len(values) + missed}"])
    return text_table(["records", "time, ms", *QUANTILES, "missed"], rows)


def measure(folder: Path, frames: int = FRAMES) -> Iterator[str]:
    """Measure records a second, then the latency of `frames` frames or more; yields lines of text."""
    bundle = load_bundle(folder)
    shown = noise(bundle)
    shape = " × ".join(map(str, shown.shape[1:]))
    load = os.getloadavg()[0]  # before anything is measured, so of other programs
    yield f"{folder}, {shape}, emulator on {os.cpu_count()} cores; load of other programs {load:.1f}"
    with served(bundle, folder) as kinds:
        yield f"as fast as they go, the fastest of {REPEATS} runs over {RATE_FRAMES} frames:"
        yield rates(kinds, shown)
    with served(bundle, folder) as kinds:
        yield f"one at a time, {CAMERA_HZ} frames/s, from a frame to its record in another process:"
        yield latencies(kinds, shown, frames)
