"""A stream that runs elsewhere, into sinks: every record, the sinks closed, and Ctrl-C while none comes."""

import os
import signal
import threading

import numpy as np
import pytest
from offered import offered

from fastac.streaming.about import About
from fastac.streaming.client import connect
from fastac.streaming.record import StreamRecord
from fastac.streaming.relay import relay

ABOUT = About(
    scene="tiny",
    bundle_sha256="ab" * 32,
    height_px=4,
    width_px=4,
    channels=("B", "G", "R"),
    pitch_mm=0.25,
    depth_origin_px=(1, 1),
    force_axes=("z",),
    arrays=("depth_mm",),
    validity=(),
    via="emulator",
    simulated_clock=True,
    clock_mhz=100.0,
    source="data.h5",
)
RECORDS = [
    StreamRecord(k, k, force_n={"z": 0.5 * k}, arrays={"depth_mm": np.full((2, 2), k, np.float32)})
    for k in range(5)
]


class Kept:
    """A sink that keeps the digests; on_add is called after each record."""

    def __init__(self, on_add=lambda: None):
        self.digests, self.closed, self._on_add = [], 0, on_add

    def add(self, record):
        self.digests.append(record.digest)
        self._on_add()

    def close(self):
        self.closed += 1


def test_every_sink_has_every_record_and_is_closed():
    sinks = [Kept(), Kept()]
    with offered(ABOUT, RECORDS) as address, connect(address) as stream:
        assert not relay(stream, sinks)
        assert stream.missed == 0
    for sink in sinks:
        assert sink.digests == [record.digest for record in RECORDS]
        assert sink.closed == 1


def test_it_ends_after_as_many_records_as_asked_for():
    sink = Kept()
    with offered(ABOUT, RECORDS, ends=False) as address, connect(address) as stream:
        assert not relay(stream, [sink], frames=2)
    assert len(sink.digests) == 2
    assert sink.closed == 1


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_wait_for_a_record(signal_number):
    def ask():
        if len(sink.digests) == len(RECORDS):
            threading.Timer(0.2, os.kill, (os.getpid(), signal_number)).start()

    sink = Kept(ask)
    with offered(ABOUT, RECORDS, ends=False) as address, connect(address) as stream:
        assert relay(stream, [sink])
    assert len(sink.digests) == len(RECORDS)
    assert sink.closed == 1


def test_sinks_are_closed_where_one_fails():
    class Full(Kept):
        def add(self, record):
            raise OSError("no space left")

    before, full = Kept(), Full()
    with (
        offered(ABOUT, RECORDS) as address,
        connect(address) as stream,
        pytest.raises(OSError, match="no space left"),
    ):
        relay(stream, [before, full])
    assert len(before.digests) == 1
    assert (before.closed, full.closed) == (1, 1)
