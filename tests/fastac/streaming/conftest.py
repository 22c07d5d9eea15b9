"""Streams of a small design behind every transport, and records without any hardware."""

import numpy as np
import pytest
from driven_design import (  # noqa: F401
    bundle,
    description,
    expected,
    frames,
    opened,
    recalibrated,
    simulation,
    simulator_folder,
    verilog,
)

from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord, Timing
from fastac.streaming.server import Publisher

ANY = "tcp://127.0.0.1:*"
"""Any port that is free."""


@pytest.fixture
def about() -> About:
    return About(
        scene="small",
        bundle_sha256="0" * 64,
        height_px=4,
        width_px=5,
        channels=("B", "G", "R"),
        pitch_mm=0.25,
        depth_origin_px=(1, 1),
        force_axes=("x", "z"),
        arrays=("depth_mm",),
        validity=("change",),
        via="emulator",
        simulated_clock=True,
        clock_mhz=150.0,
        source="data.h5",
        frames_per_second=100.0,
    )


@pytest.fixture
def make_record():
    """`make_record(3)`: the record of frame 3, with a depth of (2, 3) px."""

    def make(frame: int, **changes) -> StreamRecord:
        facts = {
            "suspect": True,
            "reasons": ("change",),
            "errors": ("late",),
            "force_n": {"x": -0.5, "z": 1.25},
            "force_raw": {"x": -(2**60) - 1, "z": 2**62 + 3},
            "arrays": {"depth_mm": np.arange(6, dtype=np.float32).reshape(2, 3) + frame},
            "timing": Timing(1e-6, 2e-6, 0.5, 3e-3, 1_700_000_000_123_456_789),
        }
        return StreamRecord(frame, 10_000_000 * frame, **facts | changes)

    return make


@pytest.fixture
def publisher(about):
    """A publisher that keeps few messages for slow readers, its stream announced."""
    found = Publisher(ANY, kept=4)
    found.announce(about)
    yield found
    found.close()
