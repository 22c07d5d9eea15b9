"""A stream's description and records with values in every field, for tests of what reads streams."""

from collections.abc import Sequence

import numpy as np

from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord, Timing

ABOUT = About(
    scene="tiny",
    bundle_sha256="ab" * 32,
    height_px=6,
    width_px=8,
    channels=("B", "G", "R", "NIR"),
    pitch_mm=0.25,
    depth_origin_px=(1, 1),
    force_axes=("x", "y", "z"),
    arrays=("depth_mm", "normals", "force_map_n", "image"),
    validity=("change", "displacement"),
    via="emulator",
    simulated_clock=True,
    clock_mhz=150.0,
    source="data.h5",
    frames_per_second=100.0,
)


def a_record(**changes) -> StreamRecord:
    """A record in which no field has its default."""
    random = np.random.default_rng(0)
    arrays = {
        "depth_mm": random.normal(size=(4, 6)).astype(np.float32),
        "normals": random.normal(size=(6, 8, 3)).astype(np.float32),
        "force_map_n": random.normal(size=(3, 4, 6)).astype(np.float32),
        "image": random.integers(0, 256, (6, 8, 4), np.uint8),
    }
    content = {
        "frame": 7,
        "source_time_ns": 1_700_000_000_123_456_789,
        "bad": True,
        "suspect": True,
        "slipping": True,
        "reasons": ("change", "displacement"),
        "errors": ("slope_saturated",),
        "force_n": {"x": 0.125, "y": -0.25, "z": 1.1},
        "force_raw": {"x": 2**40, "y": -3, "z": 5},
        "slip_px": 0.3,
        "slip_dots": 9,
        "arrays": arrays,
        "timing": Timing(1e-4, 2e-4, 3.5, 6e-4, 1_700_000_000_200_000_000),
    }
    return StreamRecord(**(content | changes))


def sent(parts: Sequence[bytes | memoryview]) -> list[bytes]:
    """A message as it arrives."""
    return [bytes(part) for part in parts]
