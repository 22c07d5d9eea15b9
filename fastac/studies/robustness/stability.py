# amaranth: UnusedElaboratable=no
"""Long runs: one frame recurs among thousands of others and must give the same bits every time.

    fastac study stability BUILD_FOLDER

runs the frames through the emulator and, with --rtl-frames, some through the simulated hardware.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fastac.flow import hardware
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import load_bundle
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.sensor.dataset import Dataset, read
from fastac.sensor.optics import faults
from fastac.sim import check_top as simulation
from fastac.store.files import write_json
from fastac.store.progress import progress_bar

FILE = "stability.json"
BATCH = 100
EVERY = 50
"""Frames between two appearances of the recurring frame, in the emulator's batches."""
RTL_EVERY = 10
"""The same in the simulated hardware."""
NOISE_DN = 2.0
"""Standard deviation of the noise added to the other frames."""


def perturbed(frames: np.ndarray, count: int, rng: np.random.Generator, *, every: int) -> np.ndarray:
    """`count` random picks of `frames` (frames, H, W, C), with drift and noise; each `every`-th is the
    first frame, unchanged."""
    chosen = frames[rng.integers(0, len(frames), count)]
    noisy = chosen + rng.normal(0, NOISE_DN, chosen.shape) + rng.normal(0, 5)
    changed = faults.gain(np.clip(noisy, 0, 255).astype(np.uint8), rng.uniform(0.8, 1.2))
    changed[::every] = frames[0]
    return changed


def emulate(pipeline: IntegerPipeline, frames: np.ndarray, count: int, *, progress: bool) -> dict:
    """Run `count` consecutive frames in batches and compare every field of the recurring frame bit for bit.

    The last batch is the first one in reverse order; all of it is compared.
    """
    rng = np.random.default_rng(1)
    emulator = Emulator(pipeline)
    alone = emulator.run(frames[:1])
    first = perturbed(frames, min(BATCH, count), rng, every=EVERY)
    before = emulator.run(first)
    found = {"frames": 0, "recurrences": 0, "values_compared": 0, "mismatches": 0}

    def compare(result, expected, places, others) -> None:
        for name, values in vars(expected).items():
            if values is not None:
                same = getattr(result, name)[places] == values[others]
                found["values_compared"] += same.size
                found["mismatches"] += int(same.size - np.count_nonzero(same))

    with progress_bar(total=count, desc="emulator", unit="frame", enabled=progress, leave=True) as bar:
        while found["frames"] < count:
            size = min(BATCH, count - found["frames"])
            last = found["frames"] + size == count
            backwards = np.arange(size)[::-1]
            batch = first[backwards] if last else perturbed(frames, size, rng, every=EVERY)
            result = emulator.run(batch)
            if last:
                compare(result, before, slice(None), backwards)
            else:
                again = np.arange(0, size, EVERY)
                found["recurrences"] += len(again)
                compare(result, alone, again, np.zeros(len(again), int))
            found["frames"] += size
            bar.update(size)
    return found


def simulate(bundle, data: Dataset, index: np.ndarray, count: int, folder: Path, *, progress: bool) -> dict:
    """Simulate `count` frames, one of them recurring, back to back on the bundle's Verilog in `folder`."""
    hardware.check_verilog(bundle, folder / "verilog")
    frames = perturbed(data.frames[index], count, np.random.default_rng(2), every=RTL_EVERY)
    found = simulation.simulate(
        bundle,
        folder / "verilog" / f"{hardware.NAME}.v",
        frames,
        Emulator(bundle.pipeline).run(bundle.pipeline.seen(frames)),
        folder / "stability",
        name=hardware.NAME,
        progress=progress,
    )
    # The reference gives one answer for the recurring frame, and the hardware gave the reference's each time.
    return {
        "frames": found.frames,
        "recurrences": len(range(0, count, RTL_EVERY)),
        "values_compared": found.values_compared,
        "markers_compared": found.markers_compared,
        "mismatches": found.mismatches,
        "first_mismatch": found.first_mismatch,
        "cycles": found.cycles,
    }


def measure(folder: Path, *, frames: int, rtl_frames: int, progress: bool) -> Iterator[str]:
    """Run the frames of a build folder's dataset; writes stability.json there and yields lines of text.

    Raises ValueError where the recurring frame gives different bits.
    """
    bundle = load_bundle(folder)
    data = read(folder / "data.h5", bundle.scene)
    index = data.indices("test")
    content = {"scene": bundle.scene.name, "bundle_sha256": bundle.digest}
    pipeline = bundle.pipeline
    content["emulator"] = found = emulate(pipeline, data.frames[index], frames, progress=progress)
    write_json(folder / FILE, content)
    yield (
        f"emulator: {found['frames']:,} frames, the same one {found['recurrences']:,} times:"
        f" {found['mismatches']} mismatches in {found['values_compared']:,} values"
    )
    if rtl_frames:
        content["rtl"] = found = simulate(bundle, data, index, rtl_frames, folder, progress=progress)
        write_json(folder / FILE, content)
        yield (
            f"RTL: {found['frames']} frames back to back, the same one {found['recurrences']} times:"
            f" {found['mismatches']} mismatches in {found['values_compared']:,} values"
            f" and {found['markers_compared']:,} stream markers"
        )
    if any(part["mismatches"] for part in content.values() if isinstance(part, dict)):
        raise ValueError(f"{folder / FILE}: the recurring frame gave different bits")
