"""Times of the software models: float and integer pipeline, ms per frame (`make bench`)."""

import sys
import time
from pathlib import Path

import numpy as np

from fastac.cli import load_bundle
from models.float_pipeline import FloatPipeline

FRAMES, REPEATS = 32, 5


def milliseconds_per_frame(pipeline, frames: np.ndarray) -> float:
    """The fastest of `REPEATS` runs: the machine's noise only ever adds."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        pipeline.run(frames)
        times.append(time.perf_counter() - start)
    return 1e3 * min(times) / len(frames)


def main(folder: Path) -> None:
    bundle = load_bundle(folder)
    shape = bundle.pipeline.background.shape
    noise = np.random.default_rng(1).integers(-20, 21, (FRAMES, *shape))
    frames = np.clip(bundle.pipeline.background + noise, 0, 255).astype(np.uint8)
    for name, pipeline in (("float", FloatPipeline.from_bundle(bundle)), ("integer", bundle.pipeline)):
        print(f"{name:8s} {milliseconds_per_frame(pipeline, frames):8.2f} ms per frame of {shape}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
