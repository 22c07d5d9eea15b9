"""Records of a session into sinks."""

import threading
from types import SimpleNamespace

import pytest

from fastac.driver.run import Stop
from fastac.streaming.client import connect
from fastac.streaming.run import await_readers, pump


class Kept:
    """A sink that keeps what it gets, and fails at the frame `fails`."""

    def __init__(self, fails: int | None = None):
        self.frames, self.closed, self.fails = [], 0, fails

    def add(self, record) -> None:
        if record.frame == self.fails:
            raise OSError("no space left")
        self.frames.append(record.frame)

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def session(make_record):
    """A session without hardware: ten records, and what was asked of it."""

    def records(*, frames=None, in_flight=None, stop=None):
        for k in range(frames or 10):
            if stop.asked:
                return
            yield make_record(k)

    return SimpleNamespace(records=records)


def test_every_sink_gets_every_record(session):
    sinks = [Kept(), Kept()]
    assert pump(session, sinks, frames=4) is False
    assert [(one.frames, one.closed) for one in sinks] == [([0, 1, 2, 3], 1)] * 2


def test_a_stop_is_told(session):
    stop, sink = Stop(), Kept()
    sink.add = lambda record: setattr(stop, "asked", record.frame == 2)
    assert pump(session, [sink], stop=stop) is True
    assert sink.closed == 1


def test_a_sink_that_fails_ends_the_stream_and_all_are_closed(session):
    sinks = [Kept(), Kept(fails=2), Kept()]
    with pytest.raises(OSError, match="no space left"):
        pump(session, sinks)
    assert [one.closed for one in sinks] == [1, 1, 1]
    assert sinks[2].frames == [0, 1]


def test_readers_are_waited_for(session, publisher):
    """The first record is not sent before they are there."""
    found = []

    def read() -> None:
        with connect(publisher.address) as stream:
            found.append([one.frame for one in stream])

    threads = [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    await_readers(publisher, 2, Stop(), progress=False)
    pump(session, [publisher], frames=3)
    for thread in threads:
        thread.join()
    assert found == [[0, 1, 2]] * 2


def test_a_stop_ends_the_wait(publisher, capsys):
    stop = Stop()
    stop.asked = True
    await_readers(publisher, 1, stop, progress=True)
    assert capsys.readouterr().err == ""
