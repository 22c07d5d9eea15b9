"""A process that reads a stream and notes when it had each record; it imports what a reader must, no more."""

import time
from multiprocessing import get_context
from multiprocessing.connection import Connection

import numpy as np

from fastac.streaming.client import connect


class Reader:
    """Reads the stream at `address` in another process until the stream ends."""

    def __init__(self, address: str):
        context = get_context("spawn")
        self._here, there = context.Pipe()
        self._process = context.Process(target=_read, args=(address, there), daemon=True)
        self._process.start()
        there.close()

    def times(self) -> tuple[np.ndarray, int]:
        """After the stream ends: of each record the s from its frame's time stamp, which is of the monotonic
        clock, to the decoded record, and those in the driver (records, 2); how many records were missed."""
        found = self._here.recv()
        self._process.join()
        return found


def _read(address: str, pipe: Connection) -> None:
    rows = []
    with connect(address, timeout_s=60) as stream:
        for record in stream:
            taken_s = 1e-9 * (time.monotonic_ns() - record.source_time_ns)
            rows.append((taken_s, record.timing.host_latency_s))
        pipe.send((np.array(rows), stream.missed))
