"""Views beside the stream: what shows leaves records out and counts them, what keeps a log has them all."""

import threading

import pytest

from fastac.streaming.record import StreamRecord
from fastac.streaming.views.worker import Every, Newest

WAIT_S = 20


class Slow:
    """A view that takes its next record when it is told to."""

    def __init__(self):
        self.frames, self.skipped, self.closed = [], [], False
        self.begun, self.go_on = threading.Semaphore(0), threading.Semaphore(0)

    def take(self, record: StreamRecord, left_out: int) -> None:
        self.begun.release()
        assert self.go_on.acquire(timeout=WAIT_S)
        self.frames.append(record.frame)
        self.skipped.append(left_out)

    def close(self) -> None:
        self.closed = True


def record(frame: int) -> StreamRecord:
    return StreamRecord(frame, 0)


def test_the_newest_is_shown_and_those_before_it_are_counted():
    view = Slow()
    sink = Newest(view.take, per_second=1e6, done=view.close)
    sink.add(record(0))
    assert view.begun.acquire(timeout=WAIT_S)
    for frame in range(1, 6):  # while the view is at frame 0
        sink.add(record(frame))
    assert sink.left_out == 4
    for _ in range(2):
        view.go_on.release()
    sink.close()
    assert (view.frames, view.skipped, view.closed) == ([0, 5], [0, 4], True)
    assert (sink.taken, sink.left_out) == (2, 4)


def test_a_log_has_every_record_though_it_is_slower_than_the_stream():
    view = Slow()
    sink = Every(view.take, done=view.close, waiting=3)
    added = threading.Event()

    def stream() -> None:
        for frame in range(50):
            sink.add(record(frame))
        added.set()

    thread = threading.Thread(target=stream)
    thread.start()
    assert view.begun.acquire(timeout=WAIT_S)
    assert not added.wait(0.05)  # the stream waits: three records do
    for _ in range(50):
        view.go_on.release()
    thread.join(WAIT_S)
    sink.close()
    assert (view.frames, view.skipped, view.closed) == (list(range(50)), [0] * 50, True)
    assert (sink.taken, sink.left_out) == (50, 0)


@pytest.mark.parametrize("kind", ["newest", "every"])
def test_what_a_view_raises_ends_the_stream(kind):
    ended = threading.Event()

    def broken(record: StreamRecord, left_out: int) -> None:
        raise OSError("no space left")

    if kind == "newest":
        sink = Newest(broken, per_second=1e6, done=ended.set)
    else:
        sink = Every(broken, done=ended.set, waiting=1)

    def stream() -> None:
        for frame in range(1000):  # also where the records that wait are never taken
            sink.add(record(frame))
            ended.wait(WAIT_S)

    with pytest.raises(OSError, match="no space left"):
        stream()
    sink.close()  # it has been said


def test_an_error_of_the_last_record_is_raised_at_the_end():
    def broken(record: StreamRecord, left_out: int) -> None:
        raise OSError("no space left")

    sink = Every(broken)
    sink.add(record(0))
    with pytest.raises(OSError, match="no space left"):
        sink.close()
