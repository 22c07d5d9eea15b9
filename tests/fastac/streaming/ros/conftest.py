"""Records of every kind: all arrays and axes, a stream that misses most of them, lost and flagged frames."""

import numpy as np
import pytest

from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord, Timing

FULL, SMALL = "everything", "force and depth"


def stream(kind: str) -> About:
    full = kind == FULL
    return About(
        scene="tiny",
        bundle_sha256="ab" * 32,
        height_px=6,
        width_px=8,
        channels=("B", "G", "R", "NIR") if full else ("B", "G", "R"),
        pitch_mm=0.25,
        depth_origin_px=(1, 1),
        force_axes=("x", "y", "z") if full else ("z",),
        arrays=("depth_mm", "normals", "force_map_n", "image") if full else ("depth_mm",),
        validity=("change", "level"),
        via="emulator",
        simulated_clock=True,
        clock_mhz=100.0,
        source="data.h5",
        frames_per_second=100.0,
    )


def arrays_of(about: About, rng) -> dict[str, np.ndarray]:
    h, w = about.height_px, about.width_px
    normals = rng.normal(size=(h, w, 3)).astype(np.float32)
    made = {
        "depth_mm": rng.normal(2, 1, (h - 2, w - 2)).astype(np.float32),
        "normals": normals / np.linalg.norm(normals, axis=-1, keepdims=True),
        "force_map_n": rng.normal(size=(len(about.force_axes), h - 2, w - 2)).astype(np.float32),
        "image": rng.integers(0, 256, (h, w, len(about.channels)), dtype=np.uint8),
    }
    return {name: made[name] for name in about.arrays}


@pytest.fixture(params=[FULL, SMALL])
def about(request):
    return stream(request.param)


@pytest.fixture
def records(about):
    """A plain record, a flagged one and a lost one, in different seconds."""
    rng = np.random.default_rng(1)
    force = {axis: float(rng.normal()) for axis in about.force_axes}
    raw = {axis: int(rng.integers(-(2**40), 2**40)) for axis in about.force_axes}
    timing = Timing(0.001, 0.0001, 12.5, 0.003, 1_800_000_000_123_456_789)
    plain = StreamRecord(
        0,
        1_800_000_000_999_999_999,
        force_n=force,
        force_raw=raw,
        arrays=arrays_of(about, rng),
        timing=timing,
    )
    flagged = StreamRecord(
        1,
        1_800_000_001_000_000_001,
        bad=True,
        suspect=True,
        slipping=True,
        reasons=("change", "level"),
        errors=("input_cut",),
        force_n={axis: -value for axis, value in force.items()},
        force_raw=raw,
        slip_px=0.30000001192092896,
        slip_dots=17,
        arrays=arrays_of(about, rng),
        timing=timing,
    )
    seen = {name: array for name, array in arrays_of(about, rng).items() if name == "image"}
    lost = StreamRecord(2, 1_800_000_001_010_000_000, lost=True, arrays=seen, timing=Timing(made_ns=3))
    return [plain, flagged, lost]
