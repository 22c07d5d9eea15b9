"""A stream's records published over ZeroMQ, to any number of readers, in any language.

The socket is an XPUB: readers subscribe to b"record", b"about" and b"end", the first parts of the messages
(record.py, about.py, end.py), or to everything, b"". Whoever subscribes gets the description soon after.
"""

import threading
import time

import zmq

from fastac.streaming import about as descriptions
from fastac.streaming import end
from fastac.streaming import record as records
from fastac.streaming.about import About
from fastac.streaming.address import DEFAULT_ADDRESS, require
from fastac.streaming.record import StreamRecord

KEPT = 256
"""Messages that are kept for a reader that does not take them; then those that follow are left out for it."""
ANSWER_S = 0.02
"""How soon a new reader is answered while no record is sent."""
LINGER_S = 2.0
"""How long the last messages may take to leave at the end."""
SETTLE_S = 0.05
"""How long it may take to notice that readers have gone. libzmq 4.3.5 does not free a context while a message
is on its way to a reader that has just gone: it waits without end."""
FREED_S = 1.0
"""How long it may take to free the context beyond the time that messages have."""
FREEING = "fastac-publisher-end"
"""Name of the thread that frees the context."""
MOST_BYTES_IN = 256
"""Readers send nothing but the names of what they subscribe to."""
SUBSCRIBE, UNSUBSCRIBE = b"\x01", b"\x00"


class ServerError(OSError):
    """An address at which no stream can be offered; the message is one line."""


class Publisher:
    """A sink that sends each record to whoever has subscribed, and never waits for them.

    A record's arrays are sent from where they are: they must not be changed afterwards.

    address : where; a port of * is any that is free, and `address` then says which
    kept : messages that are kept for each reader that is slow
    sent : records that were sent to at least one reader
    overruns : how often a reader was so slow that records were left out for it; only the reader can know how
        many (`missed` of client.py)
    subscribers : readers that take records now

    Raises AddressError or ServerError, one line, where the address is none or is in use.
    """

    def __init__(self, address: str = DEFAULT_ADDRESS, *, kept: int = KEPT):
        require(address)
        self.sent = self.overruns = self.subscribers = 0
        self._records = 0
        self._about: About | None = None
        self._context = zmq.Context()
        self._socket = socket = self._context.socket(zmq.XPUB)
        socket.sndhwm = kept
        socket.setsockopt(zmq.XPUB_VERBOSER, 1)  # every reader's subscription is shown, not only the first
        socket.setsockopt(zmq.XPUB_NODROP, 1)  # so that it can be known who is slow
        socket.setsockopt(zmq.TCP_KEEPALIVE, 1)
        socket.maxmsgsize = MOST_BYTES_IN
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            hint = "; name another with --bind" if error.errno == zmq.EADDRINUSE else ""
            raise ServerError(f"{address}: {zmq.strerror(error.errno)}{hint}") from None
        self.address = socket.last_endpoint.decode()
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._answer_on, name="fastac-publisher", daemon=True)
        self._thread.start()

    def announce(self, about: About) -> None:
        """Describe the stream to all who listen and to those who come."""
        with self._lock:
            self._about = about
            self._send(descriptions.encode(about))

    def add(self, record: StreamRecord) -> None:
        self._records += 1
        with self._lock:
            self._answer()
            if self.subscribers:
                self.sent += 1
                self.overruns += not self._send(records.encode(record))

    def close(self) -> None:
        """Send the end of the stream, wait a little until all has left, and free the address."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._thread.join()
        self._answer()
        last, until = end.encode(end.End(self._records)), time.monotonic() + LINGER_S
        is_slow = not self._send(last) or self.overruns
        while is_slow and self.subscribers and time.monotonic() < until:
            time.sleep(ANSWER_S)  # a slow reader gets the end only once it has room again
            self._send(last)
            self._answer()
        left_s = max(SETTLE_S, until - time.monotonic())
        self._socket.unbind(self.address)  # free, whatever becomes of the context
        settled = time.monotonic() + SETTLE_S
        while time.monotonic() < settled:
            time.sleep(SETTLE_S / 10)
            self._answer()
        freeing = threading.Thread(
            target=self._context.destroy, args=(round(1e3 * left_s),), name=FREEING, daemon=True
        )
        freeing.start()
        freeing.join(left_s + FREED_S)

    def _answer_on(self) -> None:
        while not self._closing.wait(ANSWER_S):
            with self._lock:
                self._answer()

    def _answer(self) -> None:
        """Take note of who has come and gone, and describe the stream to those who have come."""
        is_asked = False
        while True:
            try:
                message = self._socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                break
            kind, topic = message[:1], message[1:]
            is_new = kind == SUBSCRIBE
            if records.TOPIC.startswith(topic) and kind in (SUBSCRIBE, UNSUBSCRIBE):
                self.subscribers = max(0, self.subscribers + (1 if is_new else -1))
            is_asked |= is_new and descriptions.TOPIC.startswith(topic)
        if is_asked and self._about is not None:
            self._send(descriptions.encode(self._about))

    def _offered(self, parts: list[bytes | memoryview]) -> bool:
        """Whether each reader had room, of those that had any the last time; else no reader got it."""
        try:
            self._socket.send_multipart(parts, zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return False
        return True

    def _send(self, parts: list[bytes | memoryview]) -> bool:
        """Send to those readers that have room; whether none is new among those that have not."""
        if self._offered(parts):
            return True
        self._socket.setsockopt(zmq.XPUB_NODROP, 0)
        self._offered(parts)
        self._socket.setsockopt(zmq.XPUB_NODROP, 1)
        return False
