"""The live view as a page that this machine serves to its browsers: nothing is installed or loaded elsewhere.

Each browser gets the newest record when it has drawn the one before, at most PER_SECOND of them; forces,
latencies and flags of all others come with it, so that curves have every frame. The stream waits for none.
"""

import logging
import threading
import time
from collections import deque
from itertools import islice

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from fastac.driver.live import StatusLine
from fastac.driver.run import Stop
from fastac.streaming import json_text
from fastac.streaming.record import StreamRecord
from fastac.streaming.views import page_message
from fastac.streaming.views.page_access import Access
from fastac.streaming.views.pictures import Sight
from fastac.streaming.views.rate import FrameRate

LOCAL = "127.0.0.1"
PER_SECOND = 30.0
"""Most records a second that a browser is sent."""
KEPT = 4000
"""Latest frames whose numbers are kept for the curves."""
BEFORE = 1000
"""Frames before the first one that is shown in a browser whose numbers it gets."""
LOOK_S = 0.5
"""How soon it is noticed that a browser has gone while no records come."""
STOP_S = 0.1
"""How soon Ctrl-C is noticed while a browser is waited for."""
FLAGS = ("slipping", "suspect", "bad", "lost")
"""A frame's flags from the least to the gravest: bits 0 to 3 of the curve of flags."""


class PageError(OSError):
    """An address at which no page can be served; the message is one line."""


class PageView:
    """A sink that shows the newest records in any number of browsers.

    host, port : where to listen; port 0: any that is free. token : as of `Access`
    url : what to open in a browser; viewers : browsers that are connected
    sent, left_out : records that browsers were sent, and that they were not, over all browsers
    first_picture_ns : when the first browser had drawn its first record, ns since 1970; None before

    Raises PageError where the address cannot be used.
    """

    def __init__(self, *, host: str = LOCAL, port: int = 0, token: str | None = None):
        quiet = logging.getLogger("fastac.page")
        quiet.setLevel(logging.CRITICAL + 1)  # a browser that breaks off is no event
        try:
            self._server = serve(
                self._attend,
                host,
                port,
                process_request=lambda connection, request: self._access.answer(request),
                compression=None,
                max_size=2**10,
                close_timeout=1,
                server_header=None,
                logger=quiet,
            )
        except OSError as error:
            raise PageError(f"{host}:{port}: {error.strerror or error}") from None
        port = self._server.socket.getsockname()[1]
        self._access = Access(host, port, token)
        name = f"[{host}]" if ":" in host else host
        self.url = f"http://{name}:{port}/?token={self._access.token}"
        self.viewers = self.sent = self.left_out = 0
        self.first_picture_ns: int | None = None
        self._changed, self._packing = threading.Condition(), threading.Lock()
        self._sight: Sight | None = None
        self._newest: StreamRecord | None = None
        self._count, self._rate, self._per_second = 0, FrameRate(), None
        self._history: deque[list] = deque(maxlen=KEPT)
        self._packed: tuple[int, tuple] = (0, ())
        self._closed = False
        self._thread = threading.Thread(target=self._server.serve_forever, name="fastac-page", daemon=True)
        self._thread.start()

    def describe(self, sight: Sight) -> None:
        """Say what the records that follow are of."""
        with self._changed:
            self._sight = sight
            self._changed.notify_all()

    def await_viewer(self, stop: Stop, *, progress: bool) -> None:
        """Wait until a browser has opened the page, or an end is asked for."""
        line = StatusLine(enabled=progress)
        while not (self.viewers or stop.asked):
            line.show(lambda: "waiting until the page is opened")
            with self._changed:
                self._changed.wait(STOP_S)
        line.close()

    def add(self, record: StreamRecord) -> None:
        timing = record.timing
        latencies = timing.first_pixel_to_result_s, timing.host_latency_s
        row = [
            record.source_time_ns / 1e9,
            [record.force_n.get(axis) for axis in self._sight.about.force_axes],
            [None if s is None else round(1e3 * s, 6) for s in latencies],
            sum(getattr(record, name) << bit for bit, name in enumerate(FLAGS)),
        ]
        with self._changed:
            self._newest = record
            self._count += 1
            self._history.append(row)
            self._per_second = self._rate.add(timing.made_ns)
            self._changed.notify_all()

    def close(self) -> None:
        """Show the last record to whoever waits for it, and end; may be called again."""
        if self._closed:
            return
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._server.shutdown()
        self._thread.join()

    def _attend(self, connection: ServerConnection) -> None:
        """Serve one browser until it leaves or the stream ends."""
        with self._changed:
            self.viewers += 1
            self._changed.notify_all()
        try:
            self._show(connection)
        except ConnectionClosed:
            pass
        finally:
            with self._changed:
                self.viewers -= 1

    def _show(self, connection: ServerConnection) -> None:
        if not self._await(connection, lambda: self._sight is not None):
            return
        connection.send(page_message.of_about(self._sight))
        last = max(0, self._count - 1)  # the newest record at once
        shown = left_out = 0
        while self._await(connection, lambda last=last: self._count > last):
            sent_s = time.monotonic()
            with self._changed:
                count, record, rate = self._count, self._newest, self._per_second
                rows = count - last if shown else BEFORE  # a new browser's curves begin filled
                history = list(islice(self._history, max(0, len(self._history) - rows), None))
                self.left_out += count - last - 1
                self.sent += 1
            left_out += count - last - 1
            shown, last = shown + 1, count
            counts = {"shown": shown, "left_out": left_out, "frames_per_second": rate, "history": history}
            connection.send(self._message(count, record, counts))
            connection.recv()  # it has been drawn
            if self.first_picture_ns is None:
                self.first_picture_ns = time.time_ns()
            time.sleep(max(0, sent_s + 1 / PER_SECOND - time.monotonic()))

    def _await(self, connection: ServerConnection, ready) -> bool:
        """Wait until something is ready; False where the stream ends or the browser has gone before."""
        with self._changed:
            while not ready():
                if self._closed or connection.close_code is not None:
                    return False
                self._changed.wait(LOOK_S)
        return True

    def _message(self, count: int, record: StreamRecord, counts: dict) -> bytes:
        """The record's message; what all browsers get alike is made once."""
        with self._packing:
            if self._packed[0] != count:
                self._packed = count, page_message.of_record(self._sight, record)
            facts, drawn, arrays = self._packed[1]
        return page_message.joined([*facts, json_text.write(drawn | counts), *arrays])
