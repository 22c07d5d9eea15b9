"""What the driver costs: frames through it and the emulator, against the emulator alone.

    fastac bench driver BUILD_FOLDER

Both compute the same frames in groups of as many as the driver has in flight, and the forces of each. Their
difference is small beside what other processes do to either; so the driver is also timed alone, with the
emulator's results at hand: registers, packets, records, units.
"""

from pathlib import Path

import numpy as np

from fastac.driver import description as descriptions
from fastac.driver.driver import Driver
from fastac.driver.transports.emulator import EmulatorTransport
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import load_bundle
from fastac.models.result import Result
from fastac.report.tables import text_table
from fastac.scenes.outputs import hardware_words
from fastac.studies.benchmarks.timing import fastest

FRAMES, REPEATS = 96, 20
NOISE = 12
"""Of the frames, in digital numbers, around the background: so much that they are judged, and not suspect."""


class _AtHand:
    """In place of an emulator: what it found before, by the number of frames."""

    def __init__(self, emulator: Emulator, frames: np.ndarray, size: int, wanted: tuple[str, ...]):
        self._found = {n: emulator.run(frames[:n], wanted=wanted) for n in range(1, size + 1)}

    def run(self, frames: np.ndarray, *, wanted: tuple[str, ...]) -> Result:
        return self._found[len(frames)]


def measure(folder: Path, verilog: Path | None = None) -> list[str]:
    """Lines of a table: wall-clock and processor time a frame, and what the driver adds."""
    bundle = load_bundle(folder)
    description = descriptions.read(verilog or folder / "verilog")
    background, rng = bundle.pipeline.background, np.random.default_rng(1)
    noise = background + rng.integers(-NOISE, NOISE + 1, (FRAMES, *background.shape))
    frames = np.clip(noise, 0, 255).astype(np.uint8)
    transport = EmulatorTransport(bundle, description)
    emulator, driver, size = (
        Emulator(bundle.pipeline),
        Driver(transport, description),
        transport.frames_in_flight,
    )
    wanted = ("validity", *hardware_words(bundle.scene.outputs))

    def alone() -> None:
        for start in range(0, FRAMES, size):
            emulator.run(frames[start : start + size], wanted=wanted)

    def driven() -> None:
        for found in driver.frames(frames):
            _ = found.force_n

    rows = []
    for name, work in (("emulator alone", alone), ("driver and emulator", driven)):
        work()
        seconds = fastest(work, REPEATS)
        rows.append([name, *(f"{1e6 * value / FRAMES:.0f}" for value in seconds)])
    model = transport.model
    model.emulator = _AtHand(model.emulator, frames, size, model.wanted)
    seconds = fastest(driven, REPEATS)
    rows.append(["driver alone", *(f"{1e6 * value / FRAMES:.0f}" for value in seconds)])
    shape = " × ".join(map(str, background.shape))
    return [
        f"{folder}, {shape}, {size} frames in flight:",
        text_table(["", "µs a frame", "processor µs a frame"], rows),
    ]
