"""Records of a stream out of frames and a driver, whatever the driver's hardware is."""

import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from fastac.driver.description import Description
from fastac.driver.driver import Driver
from fastac.driver.packets import Found
from fastac.scenes.schema import Scene
from fastac.streaming.about import About
from fastac.streaming.clock import Stamped
from fastac.streaming.record import ARRAYS, StreamRecord, Timing

OUTPUTS = {"depth_mm": "depth", "normals": "normals", "force_map_n": "force_map"}
"""The image output of the hardware that an array is made of."""


def available(description: Description) -> tuple[str, ...]:
    """The arrays that records of this hardware can have."""
    there = {output.name for output in description.outputs}
    return tuple(name for name in ARRAYS if name == "image" or OUTPUTS[name] in there)


def require(description: Description, arrays: Sequence[str]) -> None:
    """Raise ValueError, one line, for an array that this hardware does not find."""
    there = available(description)
    for name in arrays:
        if name not in there:
            raise ValueError(f"array {name!r}: this stream can have {', '.join(there)}")


def about(
    scene: Scene,
    description: Description,
    *,
    arrays: Sequence[str],
    via: str,
    source: str,
    frames_per_second: float | None,
) -> About:
    """The description of a stream of this hardware."""
    return About(
        scene=description.scene,
        bundle_sha256=description.bundle_sha256,
        height_px=description.frame.height_px,
        width_px=description.frame.width_px,
        channels=description.frame.channels,
        pitch_mm=scene.sensor.pitch_mm,
        depth_origin_px=(1, 1),
        force_axes=description.force.axes if description.force else (),
        arrays=tuple(arrays),
        validity=description.validity,
        via=via,
        simulated_clock=via in ("emulator", "sim"),
        clock_mhz=description.clock_mhz,
        source=source,
        frames_per_second=frames_per_second,
    )


def records(
    driver: Driver, frames: Iterable[Stamped], *, arrays: Sequence[str] = (), in_flight: int | None = None
) -> Iterator[StreamRecord]:
    """The record of each frame, in order; none is left out.

    arrays : which of `available` the records have
    in_flight : as of `Driver.frames`: 1 for the least delay, None for the highest rate
    Raises ValueError for an array that this hardware does not find.
    """
    require(driver.description, arrays)
    waiting: deque[Stamped] = deque()

    def sent() -> Iterator[np.ndarray]:
        for stamped in frames:
            waiting.append(stamped)
            yield stamped[1]

    for number, found in enumerate(driver.frames(sent(), in_flight=in_flight)):
        time_ns, frame = waiting.popleft()
        yield record_of(found, number, time_ns, frame, arrays)


def record_of(
    found: Found, number: int, source_time_ns: int, frame: np.ndarray, arrays: Sequence[str]
) -> StreamRecord:
    """The record of what the hardware found in a frame (H, W, C) uint8."""
    made_ns = time.time_ns()
    if found.lost:
        seen = {"image": frame} if "image" in arrays else {}
        return StreamRecord(number, source_time_ns, lost=True, arrays=seen, timing=Timing(made_ns=made_ns))
    images = {name: frame if name == "image" else getattr(found, name) for name in arrays}
    axes = found.force_axes
    return StreamRecord(
        frame=number,
        source_time_ns=source_time_ns,
        bad=bool(found.bad),
        suspect=bool(found.suspect),
        slipping=bool(found.slipping),
        reasons=found.reasons,
        errors=found.errors,
        force_n=dict(zip(axes, found.force_n.tolist(), strict=True)) if axes else {},
        force_raw=dict(zip(axes, found.force_raw.tolist(), strict=True)) if axes else {},
        slip_px=None if found.slip_px is None else float(found.slip_px),
        slip_dots=None if found.slip_dots is None else int(found.slip_dots),
        arrays=images,
        timing=Timing(
            float(found.first_pixel_to_result_s),
            float(found.last_pixel_to_result_s),
            float(found.time_s),
            float(found.host_latency_s),
            made_ns,
        ),
    )
