"""A stream's messages as a reader gets them: all of them, or only the newest."""

import contextlib
import threading
import time

import zmq

from fastac.streaming import about, end
from fastac.streaming.address import require
from fastac.streaming.record import FIXED_PARTS, MAX_ARRAY_BYTES

Parts = list[bytes | memoryview]
KEPT = 256
"""Messages that wait for a reader that does not take them, beside those that the server keeps for it."""
LOOK_MS = 100
"""How soon a wait notices that it is to end."""


class StreamError(ConnectionError):
    """No server answers at an address, or it is gone before its stream's end; the message is one line."""


class Messages:
    """The messages that arrive from a server, in order.

    Raises AddressError or StreamError where `address` is none.
    """

    def __init__(self, address: str):
        require(address)
        self.address, self._is_gone = address, False
        self._closing = threading.Event()
        self._context = zmq.Context()
        self._socket = socket = self._context.socket(zmq.SUB)
        socket.rcvhwm, socket.maxmsgsize = KEPT, MAX_ARRAY_BYTES
        for option, value in (("KEEPALIVE", 1), ("KEEPALIVE_IDLE", 5), ("KEEPALIVE_INTVL", 1)):
            socket.setsockopt(getattr(zmq, f"TCP_{option}"), value)  # so that a pulled cable is noticed
        self._monitor = socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._poller = zmq.Poller()
        for one in (socket, self._monitor):
            self._poller.register(one, zmq.POLLIN)
        socket.subscribe(b"")
        try:
            socket.connect(address)
        except zmq.ZMQError as error:
            self.close()
            raise StreamError(f"{address}: {zmq.strerror(error.errno)}") from None

    def next(self, timeout_s: float | None = None) -> Parts | None:
        """The next message; None if none comes in time, or after `stop`.

        Raises StreamError where the server is gone and all that it sent has been given.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while not self._closing.is_set():
            with contextlib.suppress(zmq.Again):
                frames = self._socket.recv_multipart(zmq.NOBLOCK, copy=False)
                return [frame.bytes if k < FIXED_PARTS else frame.buffer for k, frame in enumerate(frames)]
            if self._is_gone:
                raise StreamError(f"{self.address}: the server is gone before the stream's end")
            left_ms = LOOK_MS if deadline is None else 1e3 * (deadline - time.monotonic())
            if left_ms <= 0:
                return None
            if self._monitor in dict(self._poller.poll(min(LOOK_MS, left_ms))):
                self._monitor.recv_multipart()  # no other event was asked for
                self._is_gone = True
        return None

    def stop(self) -> None:
        """End a wait for the next message in another thread."""
        self._closing.set()

    def close(self) -> None:
        """Release the connection; no thread may be waiting."""
        self.stop()
        if not self._context.closed:
            self._socket.disable_monitor()
            self._context.destroy(linger=0)


class Newest:
    """The newest record of a server's messages at any time: a thread takes all, and forgets the others."""

    def __init__(self, messages: Messages):
        self._messages = messages
        self._changed = threading.Condition()
        self._newest: Parts | None = None
        self._last: Parts | None = None
        self._error: StreamError | None = None
        self._is_over = False
        self._thread = threading.Thread(target=self._take, name="fastac-newest", daemon=True)
        self._thread.start()

    def _take(self) -> None:
        error = None
        try:
            while (parts := self._messages.next()) is not None and parts[0] != end.TOPIC:
                if parts[0] != about.TOPIC:
                    with self._changed:
                        self._newest = parts
                        self._changed.notify()
            self._last = parts
        except StreamError as gone:
            error = gone
        with self._changed:
            self._error, self._is_over = error, True
            self._changed.notify()

    def next(self) -> Parts | None:
        """The newest record that was not given yet, as soon as there is one; the end; None after `stop`.

        Raises StreamError where the server is gone.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._is_over)
            parts, self._newest = self._newest, None
        if parts is not None:
            return parts
        if self._error is not None:
            raise self._error
        return self._last

    def stop(self) -> None:
        """End the thread, and a wait for the next message in another one."""
        self._messages.stop()

    def close(self) -> None:
        """Release the connection."""
        self.stop()
        self._thread.join()
        self._messages.close()
