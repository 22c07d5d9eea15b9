"""A subscription keeps the newest record, and says in one line why there is none."""

import time
from dataclasses import replace

import pytest
import zmq
from records_by_hand import ABOUT, a_record, sent

from fastac.streaming import about as abouts
from fastac.streaming import record as records

SOON_S = 10


@pytest.fixture
def publisher():
    context = zmq.Context()
    socket = context.socket(zmq.XPUB)
    socket.set(zmq.LINGER, 0)
    socket.bind("tcp://127.0.0.1:0")
    yield socket
    context.destroy(linger=0)


@pytest.fixture
def subscription(part, publisher):
    """Subscribed, as the publisher knows."""
    opened = part("subscription").Subscription(publisher.get_string(zmq.LAST_ENDPOINT))
    assert publisher.poll(1000 * SOON_S)
    publisher.recv()
    yield opened
    opened.close()


def describe(publisher, **changes):
    publisher.send_multipart(sent(abouts.encode(replace(ABOUT, **changes))))


def publish(publisher, **changes):
    publisher.send_multipart(sent(records.encode(a_record(**changes))))


def test_the_newest_record_is_kept_and_lost_frames_are_counted(subscription, publisher):
    describe(publisher)
    for frame in range(3):
        publish(publisher, frame=frame)
    publish(publisher, frame=3, lost=True)
    publish(publisher, frame=4)
    assert subscription.description(SOON_S).scene == "tiny"
    fourth = subscription.newer(3, SOON_S)
    assert (fourth.record.frame, fourth.number, subscription.lost) == (4, 4, 1)
    assert subscription.newest() is fourth
    with pytest.raises(TimeoutError, match=r"no new record within 0\.01 s"):
        subscription.newer(4, 0.01)


def test_without_a_server_the_wait_ends(part):
    alone = part("subscription").Subscription("tcp://127.0.0.1:1")
    with pytest.raises(TimeoutError, match=r"no stream within 0\.01 s: is `fastac serve` running there\?"):
        alone.description(0.01)
    alone.close()
    alone.close()


def test_an_address_that_is_none_is_refused(part):
    with pytest.raises(ConnectionError, match="address = 'here': "):
        part("subscription").Subscription("here")


def test_the_end_of_a_stream_is_no_timeout(subscription, publisher, messages):
    describe(publisher)
    publish(publisher)
    publisher.send_multipart([messages.END, b"{}"])
    subscription.newer(0, SOON_S)
    with pytest.raises(ConnectionError, match="the stream has ended"):
        subscription.newer(1, SOON_S)


def test_a_server_that_starts_again_goes_on_with_the_same_sensor(subscription, publisher, messages):
    describe(publisher)
    publisher.send_multipart([messages.END, b"{}"])
    describe(publisher)
    publish(publisher, frame=1)
    # Between the end and the second description, `newer` would say that the stream has ended.
    deadline = time.monotonic() + SOON_S
    while subscription.newest() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert subscription.newer(0, SOON_S).record.frame == 1
    describe(publisher, scene="other", height_px=12)
    publish(publisher, frame=2)
    with pytest.raises(ConnectionError, match="another stream came: scene 'other' instead of 'tiny'"):
        subscription.newer(1, SOON_S)


def test_a_stream_of_another_version_is_named(subscription, publisher):
    publisher.send_multipart([b"about", b'{"format_version": 9}'])
    with pytest.raises(ConnectionError, match="description: format_version = 9: this reads 1"):
        subscription.description(SOON_S)
