"""Records over a socket: who gets what, and that nobody is waited for. Nothing here depends on speed."""

import json
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import zmq

from fastac.streaming import about as descriptions
from fastac.streaming import messages, server
from fastac.streaming import record as records
from fastac.streaming.address import AddressError, is_local
from fastac.streaming.client import connect
from fastac.streaming.server import Publisher, ServerError

MUCH = {"depth_mm": np.zeros((500, 500), np.float32)}
"""An array that fills the buffers of the operating system soon."""
ENOUGH = 500
PATIENCE_S = 30


def until(condition) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture
def subscriber():
    """`subscriber(address, topic)`: a plain socket of ZeroMQ, as other languages have it."""
    context, kept = zmq.Context(), []

    def make(address: str, topic: bytes = b"", **options) -> zmq.Socket:
        socket = context.socket(zmq.SUB)
        socket.rcvtimeo = 1000 * PATIENCE_S
        for name, value in options.items():
            setattr(socket, name, value)
        socket.subscribe(topic)
        socket.connect(address)
        kept.append(socket)
        return socket

    yield make
    context.destroy(linger=0)


def test_whoever_comes_late_gets_the_description_first(publisher, subscriber, about, make_record):
    for k in range(3):
        publisher.add(make_record(k))
    assert publisher.sent == 0  # nobody was there
    first = subscriber(publisher.address)
    assert descriptions.decode(first.recv_multipart()) == about
    publisher.add(make_record(3))
    assert records.decode(first.recv_multipart()).frame == 3
    second = subscriber(publisher.address)
    assert descriptions.decode(second.recv_multipart()) == about
    publisher.add(make_record(4))
    assert records.decode(second.recv_multipart()).frame == 4
    publisher.close()
    assert second.recv_multipart()[0] == b"end"
    found = [first.recv_multipart() for _ in range(3)]
    assert [parts[0] for parts in found] == [b"about", b"record", b"end"]
    assert json.loads(found[-1][1])["frames"] == 5


def test_topics_are_sent_to_those_who_asked(publisher, subscriber, make_record):
    ends = subscriber(publisher.address, b"end")
    only = subscriber(publisher.address, b"record")
    until(lambda: publisher.subscribers == 1)
    publisher.add(make_record(0))
    assert only.recv_multipart()[0] == b"record"
    publisher.close()
    assert ends.recv_multipart()[0] == b"end"


def test_readers_are_counted(publisher, subscriber):
    sockets = [subscriber(publisher.address) for _ in range(3)]
    until(lambda: publisher.subscribers == 3)
    sockets[0].close()
    until(lambda: publisher.subscribers == 2)
    sockets[1].unsubscribe(b"")
    until(lambda: publisher.subscribers == 1)


def test_a_reader_that_takes_nothing_delays_nobody(publisher, subscriber, make_record):
    """Records go on after its buffers are full, and another reader gets every one."""
    slow = subscriber(publisher.address, b"", rcvhwm=1, rcvbuf=4096)
    with connect(publisher.address) as stream:
        until(lambda: publisher.subscribers == 2)
        for k in range(ENOUGH):
            publisher.add(make_record(k, arrays=MUCH))
            assert next(stream).frame == k
        assert publisher.overruns > 0
        assert (publisher.sent, stream.missed) == (ENOUGH, 0)
        while (parts := slow.recv_multipart())[0] == b"about":
            pass
        assert [records.decode(found).frame for found in (parts, slow.recv_multipart())] == [0, 1]


def test_a_reader_knows_what_it_missed(publisher, make_record, monkeypatch):
    """It takes nothing until records have been left out for it; then all that there is, and the end."""
    monkeypatch.setattr(messages, "KEPT", 2)
    with connect(publisher.address) as stream:
        for k in range(ENOUGH):
            publisher.add(make_record(k, arrays=MUCH))
        assert publisher.overruns > 0
        closing = threading.Thread(target=publisher.close)
        closing.start()
        found = [record.frame for record in stream]
    closing.join()
    assert found == sorted(found)
    assert found[0] == 0
    assert len(found) < ENOUGH
    assert (stream.received, stream.missed) == (len(found), ENOUGH - len(found))


def test_an_address_in_use(publisher):
    with pytest.raises(ServerError, match=f"^{publisher.address}: Address already in use; name another"):
        Publisher(publisher.address)


@pytest.mark.parametrize(
    "address", ["5599", "localhost:5599", "tcp://localhost", "tcp://*:99999", "tcp://*:x", "udp://*:1", ""]
)
def test_texts_that_are_no_address(address):
    with pytest.raises(AddressError, match="expected an address such as tcp://127"):
        Publisher(address)


def test_an_address_of_another_machine():
    with pytest.raises(ServerError, match=r"^tcp://192\.0\.2\.1:5599: Cannot assign requested address"):
        Publisher("tcp://192.0.2.1:5599")


def test_which_addresses_are_local():
    assert all(map(is_local, ("tcp://127.0.0.1:1", "tcp://localhost:1", "tcp://[::1]:1", "ipc:///tmp/a")))
    assert not any(map(is_local, ("tcp://*:1", "tcp://0.0.0.0:1", "tcp://10.0.0.1:1")))


def test_what_readers_send_is_not_believed(publisher, make_record):
    """Messages that are no subscriptions, from a socket that may send: the stream goes on."""
    context = zmq.Context()
    socket = context.socket(zmq.XSUB)
    socket.linger = 0
    socket.connect(publisher.address)
    for message in (b"hello", b"", b"\x02record", b"\x00record", b"x" * 100_000):
        socket.send(message)
    with connect(publisher.address) as stream:
        publisher.add(make_record(0))
        assert next(stream).frame == 0
    context.destroy(linger=0)


def test_the_end_comes_again_where_there_was_no_room_for_it(publisher, make_record, monkeypatch):
    with connect(publisher.address) as stream:
        publisher.add(make_record(0))
        offered, full = publisher._offered, iter([True, True])
        monkeypatch.setattr(publisher, "_offered", lambda parts: not next(full, False) and offered(parts))
        publisher.close()
        assert [record.frame for record in stream] == [0]


def test_closing_twice(publisher):
    publisher.close()
    publisher.close()


def test_it_ends_while_readers_leave(subscriber):
    """With its last message on the way to readers that are gone, libzmq would not free the context."""
    for _ in range(40):
        publisher = Publisher("tcp://127.0.0.1:*")
        readers = [subscriber(publisher.address) for _ in range(3)]
        until(lambda publisher=publisher: publisher.subscribers == 3)
        readers[0].unsubscribe(b"")
        until(lambda publisher=publisher: publisher.subscribers == 2)
        for reader in readers:
            reader.close(linger=0)
        publisher.close()
        assert publisher._context.closed


def test_it_ends_even_if_its_context_is_not_freed(publisher, monkeypatch):
    monkeypatch.setattr(server, "FREED_S", 0.1)
    monkeypatch.setattr(server, "LINGER_S", 0.1)
    freed = threading.Event()
    whole, publisher._context = publisher._context, SimpleNamespace(destroy=lambda _: freed.wait(60))
    publisher.close()
    [freeing] = [thread for thread in threading.enumerate() if thread.name == server.FREEING]
    assert freeing.daemon
    freed.set()
    freeing.join()
    whole.destroy(linger=0)
