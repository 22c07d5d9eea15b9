"""A subscription to a FasTac stream: a thread that keeps the newest record, and no queue."""

import time
from dataclasses import dataclass
from threading import Condition, Event, Thread

import zmq

from .messages import END, About, MessageError, Record, decode

POLL_MS = 100
QUEUE = 16
"""Messages that wait in the socket; a reader wants the newest record, so more would only be old."""


@dataclass(frozen=True)
class Newest:
    """The newest record, its number among those received, from 1, and when it came, s by `time.monotonic`."""

    record: Record
    number: int
    received_s: float


class Subscription:
    """The stream at an address, such as "tcp://127.0.0.1:5599", from when it is made until it is closed.

    about : the stream's description, None before it came
    lost : how many records of lost frames came; these are never the newest record

    Raises ConnectionError, one line, where the address is none.
    """

    def __init__(self, address: str):
        self.address = address
        self.about: About | None = None
        self.lost = 0
        self._newest: Newest | None = None
        self._fault: str | None = None
        self._news = Condition()
        self._closing = Event()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        try:
            self._socket.set(zmq.LINGER, 0)
            self._socket.set(zmq.RCVHWM, QUEUE)
            self._socket.subscribe(b"")
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise ConnectionError(f"address = {address!r}: {error}") from None
        self._thread = Thread(target=self._receive, daemon=True, name=f"fastac {address}")
        self._thread.start()

    def close(self) -> None:
        """End the thread and the connection; may be called twice."""
        self._closing.set()
        self._thread.join()
        self._context.destroy(linger=0)

    def description(self, timeout_s: float) -> About:
        """The stream's description. Raises TimeoutError, or ConnectionError where it is unreadable."""
        with self._news:
            came = self._news.wait_for(lambda: self.about is not None or self._fault, timeout_s)
            if self.about is not None:
                return self.about
            if came:
                raise ConnectionError(f"{self.address}: {self._fault}")
        raise TimeoutError(
            f"{self.address}: no stream within {timeout_s:g} s: is `fastac serve` running there?"
        )

    def newer(self, than: int, timeout_s: float) -> Newest:
        """The newest record once its number is above `than`.

        Raises TimeoutError, or ConnectionError where the stream has ended or became unreadable.
        """
        with self._news:
            self._news.wait_for(lambda: self._number > than or self._fault, timeout_s)
            if self._newest is not None and self._number > than:
                return self._newest
            if self._fault:
                raise ConnectionError(f"{self.address}: {self._fault}")
        raise TimeoutError(f"{self.address}: no new record within {timeout_s:g} s")

    def newest(self) -> Newest | None:
        """The newest record, at once; None before the first."""
        with self._news:
            return self._newest

    @property
    def _number(self) -> int:
        return self._newest.number if self._newest else 0

    def _receive(self) -> None:
        while not self._closing.is_set():
            if self._socket.poll(POLL_MS):
                parts = self._socket.recv_multipart()
                with self._news:
                    self._take(parts)
                    self._news.notify_all()

    def _take(self, parts: list[bytes]) -> None:
        try:
            message = decode(parts)
        except MessageError as error:
            self._fault = str(error)
            return
        if isinstance(message, About):
            self._describe(message)
        elif isinstance(message, Record) and self._fault is None:
            self._keep(message)
        elif parts[0] == END:
            self._fault = "the stream has ended"

    def _keep(self, record: Record) -> None:
        if record.lost:
            self.lost += 1
        else:
            self._newest = Newest(record, self._number + 1, time.monotonic())

    def _describe(self, about: About) -> None:
        """A server that starts again describes its stream again, which ends a fault."""
        known = self.about
        if known is not None and _shape(known) != _shape(about):
            self._fault = f"another stream came: scene {about.scene!r} instead of {known.scene!r}"
            return
        self.about, self._fault = about, None


def _shape(about: About) -> tuple:
    return about.bundle_sha256, about.arrays, about.height_px, about.width_px, about.channels
