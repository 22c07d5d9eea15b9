# amaranth: UnusedElaboratable=no
"""A stream from its beginning: a bundle, something that computes, and a source of frames.

with open_session(Path("build/paper"), "build/paper/data.h5", via="emulator") as session:
    for record in session.records():
        print(record.frame, record.force_n)
"""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from fastac.driver import description as descriptions
from fastac.driver.description import Description
from fastac.driver.driver import TIMEOUT_S, Driver
from fastac.driver.fitting import fitting_of
from fastac.driver.run import Stop, until_stopped
from fastac.driver.sources import Source, open_source
from fastac.driver.transports.choice import open_transport
from fastac.flow.hardware import describe
from fastac.gateware.top_zynq import TopZynq
from fastac.models.integer.bundle import Bundle, load_bundle
from fastac.streaming import clock, producer
from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord

KEPT_BYTES = 2**28
"""Most bytes of a recording's frames that are kept to be sent again."""


def description_of(bundle: Bundle, verilog: Path, *, needed: bool) -> Description:
    """What the bundle's hardware says of itself: the file beside its Verilog, else as it would be written.

    needed : the Verilog itself is needed: a DescriptionError says so where it is not there
    Raises DescriptionError also where the file is of another bundle.
    """
    path = verilog / descriptions.FILE
    if path.exists() or needed:
        found = descriptions.read(verilog)
        found.require_bundle(bundle.digest, str(path))
        return found
    return descriptions.parse(json.dumps(describe(TopZynq(bundle), rtlil="")), str(path))


def repeated(
    frames: Iterable[np.ndarray], again: Callable[[], Iterable[np.ndarray]], most_bytes: int = KEPT_BYTES
) -> Iterator[np.ndarray]:
    """The frames over and over, without an end unless there is none.

    again : gives the frames anew; asked for where they take more than `most_bytes`, else they are kept
    """
    kept, size, count = [], 0, 0
    for frame in frames:
        count, size = count + 1, size + frame.nbytes
        kept.append(frame)
        if size > most_bytes:
            kept.clear()
        yield frame
    while count:
        yield from kept if size <= most_bytes else again()


@dataclass(frozen=True)
class Session:
    """Frames, and the driver that sends them to whatever computes.

    opened : the source, opened anew each time it is called
    about : the stream's description
    paced : give a recording's frames at its own rate; loop : begin a recording again at its end
    """

    bundle: Bundle
    driver: Driver
    opened: Callable[[], Source]
    about: About
    paced: bool
    loop: bool

    def records(
        self, *, frames: int | None = None, in_flight: int | None = None, stop: Stop | None = None
    ) -> Iterator[StreamRecord]:
        """The record of each frame, in order, until the source ends or `frames` have been sent.

        in_flight : as of `Driver.frames`; None: 1 where frames come at a camera's pace, else the highest rate
        stop : once it asks for an end, no further frame is sent, and those in flight are given
        """
        source = self.opened()
        paced = self.paced or source.live
        stamped = clock.arriving(source.frames) if source.live else self._recorded(source)
        if in_flight is None and paced:
            in_flight = 1
        stamped = islice(stamped, frames)
        if stop is not None:
            stamped = until_stopped(stamped, stop)
        yield from producer.records(self.driver, stamped, arrays=self.about.arrays, in_flight=in_flight)

    def _recorded(self, source: Source) -> Iterator[clock.Stamped]:
        frames = repeated(source.frames, lambda: self.opened().frames) if self.loop else source.frames
        return clock.recorded(frames, self.about.frames_per_second, paced=self.paced)


@contextmanager
def open_session(
    bundle_path: Path,
    origin: str | None = None,
    *,
    via: str = "emulator",
    arrays: Sequence[str] | None = None,
    folder: Path | None = None,
    verilog: Path | None = None,
    bitstream: Path | None = None,
    split: str = "all",
    fit: bool = False,
    frames_per_second: float | None = None,
    paced: bool = False,
    loop: bool = False,
    capture_background: bool = True,
    timeout_s: float = TIMEOUT_S,
    progress: bool = False,
) -> Iterator[Session]:
    """A stream that is ready to give its first record.

    bundle_path : a build folder, a bundle's folder, or one file of `fastac export bundle`
    folder : where data.h5, the Verilog's folder and simulators are; None: bundle_path
    origin : as `fastac.driver.sources.open_source` takes it; None: data.h5 in `folder`
    via : what computes: "emulator", "sim", "uio" or "pynq"; all but the emulator need the Verilog's folder
    arrays : which arrays the records have; None: all that there are
    fit : resample frames of any size to the sensor's; else only those of the size of the photographs that it
        was trained on
    frames_per_second : of a recording; None: its own rate, or DEFAULT_FPS of `fastac.streaming.clock`
    capture_background : let the hardware take the source's own background first, where the source has one
    Raises SourceError, BundleError, DescriptionError, TransportError or DriverError, each one line.
    """
    bundle, folder = load_bundle(bundle_path), folder or bundle_path
    verilog = verilog or folder / "verilog"
    description = description_of(bundle, verilog, needed=via != "emulator")
    origin = origin or str(folder / "data.h5")

    fitting = fitting_of(bundle.pipeline, any_size=fit)

    def opened() -> Source:
        return open_source(origin, bundle.scene, split=split, fitting=fitting, progress=progress)

    first = opened()
    rate = frames_per_second or first.frames_per_second
    if rate is None and not first.live:
        rate = clock.DEFAULT_FPS
    chosen = producer.available(description) if arrays is None else tuple(arrays)
    producer.require(description, chosen)
    with open_transport(
        via,
        description,
        bundle=bundle,
        verilog=verilog,
        folder=folder / "run",
        bitstream=bitstream,
        progress=progress,
    ) as transport:
        driver = Driver(transport, description, timeout_s=timeout_s)
        if capture_background and first.background is not None:
            driver.capture_background(first.background)
        about = producer.about(
            bundle.scene, description, arrays=chosen, via=via, source=origin, frames_per_second=rate
        )
        handed = [first]
        yield Session(bundle, driver, lambda: handed.pop() if handed else opened(), about, paced, loop)
