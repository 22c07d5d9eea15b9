"""What a live view costs: frames a second beside it, and how soon the first picture is there.

    fastac bench live BUILD_FOLDER

Frames go through the emulator as fast as they can, with nothing attached, with the page in a real browser
without a window (Chromium, driven by Selenium), and with a recording of every frame for Rerun. The first
picture is that of `fastac live` in a process of its own, until the browser, which runs already, has painted
it. Processor time is that of the stream and its views in this process; the browser's is not in it.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fastac.driver.run import Stop
from fastac.report.tables import text_table
from fastac.streaming.run import pump
from fastac.streaming.session import Session, open_session
from fastac.streaming.sink import Sink
from fastac.streaming.views import rerun_view
from fastac.streaming.views.page import PageView
from fastac.streaming.views.pictures import Sight, rest_depth_mm

WARM = 64
"""Frames that are sent first: compiled loops are loaded, and the browser has its first picture."""
WAIT_S = 120.0
SIZE_PX = (1400, 930)
SHOWN = "return Number(document.getElementById('shown').textContent)"
FIRST = re.compile(r"first picture: ([\d.]+) s")


class BenchmarkError(RuntimeError):
    """A program that the measurement needs is not there, or failed; the message is one line."""


@contextmanager
def browser(size_px: tuple[int, int] = SIZE_PX) -> Iterator:
    """Chromium without a window. Raises BenchmarkError where it or Selenium is not installed."""
    try:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service
    except ImportError:
        raise BenchmarkError("selenium: not installed: pip install -e '.[everything]'") from None
    program, driver = (shutil.which(name) for name in ("chromium", "chromedriver"))
    if program is None or driver is None:
        raise BenchmarkError("chromium, chromedriver: not installed (Debian: chromium, chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    size = ",".join(map(str, size_px))
    for argument in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "hide-scrollbars"):
        options.add_argument(f"--{argument}")
    options.add_argument(f"--window-size={size}")
    found = webdriver.Chrome(options=options, service=Service(driver))
    try:
        width, height = size_px
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        found.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        yield found
    finally:
        found.quit()


def _rates(session: Session, sinks: list[Sink], frames: int) -> tuple[str, str]:
    """Frames a second of the stream into sinks that stay open, and processor time a frame in ms."""
    begun, processor = time.monotonic(), time.process_time()
    count = 0
    for record in session.records(frames=frames):
        for sink in sinks:
            sink.add(record)
        count += 1
    seconds, processor = time.monotonic() - begun, time.process_time() - processor
    return f"{count / seconds:.0f}", f"{1e3 * processor / count:.2f}"


def measure(folder: Path, frames: int, origin: str | None = None) -> list[str]:
    """Lines of a table of rates, and the time to the first picture."""
    rows = []
    with open_session(folder, origin, loop=True) as session, tempfile.TemporaryDirectory() as temporary:
        rest = rest_depth_mm(session.bundle)
        _rates(session, [], WARM)
        rows.append(["nothing attached", *_rates(session, [], frames), "", ""])
        with browser() as window:
            page = PageView()
            page.describe(Sight(session.about, rest))
            window.get(page.url)
            until = time.monotonic() + WAIT_S
            while page.first_picture_ns is None and time.monotonic() < until:
                _rates(session, [page], WARM)
            sent, left_out = page.sent, page.left_out
            rates = _rates(session, [page], frames)
            rows.append(["page in Chromium", *rates, page.sent - sent, page.left_out - left_out])
            page.close()
        if rerun_view.installed():
            path = Path(temporary) / "every.rrd"
            log = rerun_view.logged(Sight(session.about, rest), path)
            rates = _rates(session, [log], frames)
            log.close()
            name = f"file of Rerun, {path.stat().st_size / log.taken / 1e3:.0f} kB a frame"
            rows.append([name, *rates, log.taken, log.left_out])
        shape = f"{session.about.height_px} × {session.about.width_px} px, {session.about.via}"
    table = text_table(["", "frames/s", "processor ms a frame", "shown or kept", "left out"], rows)
    return [f"{folder}, {shape}, {frames} frames:", table, first_picture(folder, origin)]


def first_picture(folder: Path, origin: str | None = None) -> str:
    """A line that says how long after its start `fastac live` has its first picture on the page."""
    arguments = [folder, "--view", "page", "--no-progress", *(("--source", origin) if origin else ())]
    program = [sys.executable, "-c", "from fastac.cli.main import main; main()", "live"]
    with browser() as window:
        process = subprocess.Popen(
            [*program, *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        try:
            address = re.search(r"http://\S+", process.stdout.readline())
            if address is None:
                raise BenchmarkError(f"fastac live {folder}: does not say where its page is")
            window.get(address[0])
            until = time.monotonic() + WAIT_S
            while window.execute_script(SHOWN) < 2 and process.poll() is None and time.monotonic() < until:
                time.sleep(0.05)
        finally:
            process.send_signal(signal.SIGINT)
            printed, _ = process.communicate(timeout=WAIT_S)
    found = FIRST.search(printed)
    if found is None:
        raise BenchmarkError(f"fastac live {folder}: no picture: {printed.strip().splitlines()[-1:]}")
    return f"first picture in the browser {found[1]} s after fastac live began"


def screenshot(folder: Path, path: Path, frames: int, origin: str | None = None, fps: float = 25.0) -> None:
    """A picture of the page after so many frames at a camera's pace, PNG."""
    with open_session(folder, origin, loop=True, paced=True, frames_per_second=fps) as session:
        page = PageView()
        page.describe(Sight(session.about, rest_depth_mm(session.bundle)))
        with browser() as window:
            window.get(page.url)
            with Stop() as stop:
                page.await_viewer(stop, progress=False)
                pump(session, [Shot(page, window, path, frames)], frames=frames, stop=stop)


class Shot:
    """A sink that hands records to a page and takes a picture of it before the page is closed."""

    def __init__(self, page: PageView, window, path: Path, last: int):
        self._page, self._window, self._path, self._last = page, window, path, last

    def add(self, record) -> None:
        self._page.add(record)

    def close(self) -> None:
        frame = "return document.getElementById('frame').textContent"
        until = time.monotonic() + WAIT_S
        while self._window.execute_script(frame) != str(self._last - 1) and time.monotonic() < until:
            time.sleep(0.05)
        self._path.write_bytes(self._window.get_screenshot_as_png())
        self._page.close()
