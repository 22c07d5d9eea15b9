"""A reader of a stream: ends, errors, the newest record, asyncio, and what it imports."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import zmq

from fastac.streaming import about as descriptions
from fastac.streaming import end
from fastac.streaming import record as records
from fastac.streaming.address import AddressError
from fastac.streaming.client import connect
from fastac.streaming.messages import StreamError
from fastac.streaming.record import RecordError

SERVER = """
import sys, time
from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord
from fastac.streaming.server import Publisher
publisher = Publisher("tcp://127.0.0.1:*")
publisher.announce(About("s", "", 4, 4, ("B",), 0.1, (1, 1), (), (), (), "emulator", True, 100.0, "", None))
print(publisher.address, flush=True)
while not publisher.subscribers:
    time.sleep(0.01)
for k in range(3):
    publisher.add(StreamRecord(k, k))
time.sleep(600)
"""


@pytest.fixture
def server(about):
    """A plain socket that sends whatever it is told to whoever has connected: `server.send_multipart`."""
    context = zmq.Context()
    socket = context.socket(zmq.PUB)
    socket.bind("tcp://127.0.0.1:*")

    stop = threading.Event()
    lock = threading.Lock()

    class Server:
        address = socket.last_endpoint.decode()

        def send(self, *parts: bytes) -> None:
            with lock:
                socket.send_multipart(parts)

    server, description = Server(), descriptions.encode(about)

    def describe() -> None:
        while not stop.wait(0.01):
            server.send(*description)

    thread = threading.Thread(target=describe)
    thread.start()
    yield server
    stop.set()
    thread.join()
    context.destroy(linger=0)


def test_records_in_order_to_the_end(publisher, about, make_record):
    with connect(publisher.address) as stream:
        assert stream.about == about
        for k in range(3):
            publisher.add(make_record(k))
        publisher.close()
        assert [one.digest for one in stream] == [make_record(k).digest for k in range(3)]
        assert list(stream) == []
    assert (stream.received, stream.missed) == (3, 0)


def test_gaps_are_counted_also_the_last_one(server, make_record):
    with connect(server.address) as stream:
        for k in (5, 6, 9):
            server.send(*records.encode(make_record(k)))
        server.send(*end.encode(end.End(13)))
        assert [one.frame for one in stream] == [5, 6, 9]
    assert (stream.received, stream.missed) == (3, 2 + 3)


def test_a_stream_that_begins_again_has_missed_nothing(server, make_record):
    with connect(server.address) as stream:
        for k in (5, 0, 1):
            server.send(*records.encode(make_record(k)))
        assert [next(stream).frame for _ in range(3)] == [5, 0, 1]
    assert stream.missed == 0


def test_the_newest_record_alone(server, make_record):
    """Whatever came while the reader was busy is skipped, and counted."""
    with connect(server.address, latest=True) as stream:
        server.send(*records.encode(make_record(0)))
        assert next(stream).frame == 0
        for k in range(1, 400):  # more than queues hold
            server.send(*records.encode(make_record(k)))
        until = time.monotonic() + 30
        found = next(stream).frame
        while found < 399:
            assert time.monotonic() < until
            before, found = found, next(stream).frame
            assert found > before
        server.send(*end.encode(end.End(400)))
        assert list(stream) == []
    assert stream.received + stream.missed == 400


def test_the_newest_record_is_given_before_the_end(server, make_record):
    with connect(server.address, latest=True) as stream:
        for parts in (records.encode(make_record(0)), records.encode(make_record(1)), end.encode(end.End(2))):
            server.send(*parts)
        stream._messages._thread.join()  # all of it has arrived
        assert [one.frame for one in stream] == [1]


def test_nobody_answers():
    with pytest.raises(
        StreamError, match=r"^tcp://127.0.0.1:1: no stream within 0.05 s; is `fastac serve` run"
    ):
        connect("tcp://127.0.0.1:1", timeout_s=0.05)
    with pytest.raises(AddressError, match=r"^elsewhere: expected an address such as"):
        connect("elsewhere")


def test_a_stream_that_has_no_description_yet(publisher, make_record):
    """Records alone do not make a stream."""
    publisher._about = None
    with pytest.raises(StreamError, match="no stream within"):
        connect(publisher.address, timeout_s=0.05)


@pytest.mark.parametrize("latest", [False, True])
def test_a_server_that_is_killed(latest):
    """What it has sent is given; then an error says that this was not the end."""
    with subprocess.Popen([sys.executable, "-c", SERVER], stdout=subprocess.PIPE, text=True) as process:
        try:
            with connect(process.stdout.readline().strip(), latest=latest, timeout_s=30) as stream:
                frame = -1
                while frame < 2:
                    frame = next(stream).frame
                os.kill(process.pid, signal.SIGKILL)
                for _ in range(2):
                    with pytest.raises(StreamError, match=r"^tcp://.*: the server is gone before the str"):
                        next(stream)
        finally:
            process.kill()


@pytest.mark.parametrize("latest", [False, True])
def test_a_damaged_message_and_then_a_good_one(server, make_record, latest):
    good = records.encode(make_record(1))
    with connect(server.address, latest=latest) as stream:
        for bad in ([b"record"], [b"noise", b"{}", b"{}"], [*good[:3]], [b""]):
            server.send(*bad)
            with pytest.raises(RecordError):
                next(stream)
        server.send(*good)
        assert next(stream).frame == 1


def test_a_damaged_description(server):
    server.send = lambda *parts: None  # hold the good ones back
    context = zmq.Context()
    socket = context.socket(zmq.XPUB)
    socket.bind("tcp://127.0.0.1:*")
    found = []

    def answer() -> None:
        socket.recv()
        socket.send_multipart([b"about", b"{}"])

    thread = threading.Thread(target=answer)
    thread.start()
    with pytest.raises(descriptions.AboutError, match="format_version = None: this version reads 1"):
        found.append(connect(socket.last_endpoint.decode()))
    thread.join()
    context.destroy(linger=0)


def test_arrays_outlive_the_stream(publisher, make_record):
    with connect(publisher.address) as stream:
        publisher.add(make_record(3, arrays={"depth_mm": np.full((300, 300), 7, np.float32)}))
        found = next(stream)
    assert found.depth_mm.sum() == 7 * 300 * 300


def test_asyncio_is_not_blocked(publisher, make_record):
    """Records are sent by the event loop itself while the reader waits for them."""

    async def both() -> list[int]:
        with connect(publisher.address) as stream:

            async def send() -> None:
                for k in range(3):
                    publisher.add(make_record(k))
                    await asyncio.sleep(0)
                publisher.close()

            sending = asyncio.ensure_future(send())
            found = [one.frame async for one in stream]
            await sending
            return found

    assert asyncio.run(both()) == [0, 1, 2]


def test_a_cancelled_wait_loses_nothing(publisher, make_record):
    async def one_after_another() -> list[int]:
        with connect(publisher.address) as stream:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(anext(stream), 0.05)
            publisher.add(make_record(0))
            publisher.add(make_record(1))
            return [(await anext(stream)).frame for _ in range(2)]

    assert asyncio.run(one_after_another()) == [0, 1]


def test_closing_ends_a_wait(publisher):
    """A stream is closed although a cancelled wait still runs in its thread."""

    async def cancelled() -> None:
        with connect(publisher.address) as stream, pytest.raises(TimeoutError):
            await asyncio.wait_for(anext(stream), 0.05)

    asyncio.run(cancelled())


def test_a_reader_needs_numpy_and_zeromq_alone():
    code = "import fastac.streaming.client, sys; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    installed = set(found.split()) - set(sys.stdlib_module_names)
    heavy = {"torch", "amaranth", "numba", "scipy", "h5py", "cv2", "av", "click", "pydantic", "matplotlib"}
    assert {"numpy", "zmq", "fastac"} <= installed
    assert not installed & heavy
