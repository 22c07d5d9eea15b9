"""The page's server: who may see it, what a browser gets, and that the stream waits for none."""

import http.client
import json
import socket
import threading
from dataclasses import replace
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosedOK, InvalidStatus
from websockets.sync.client import connect

from fastac.streaming.session import open_session
from fastac.streaming.views import page_message
from fastac.streaming.views.page import PageError, PageView
from fastac.streaming.views.page_access import FILES
from fastac.streaming.views.pictures import Sight, colours_of_normals, rest_depth_mm

WAIT_S = 20


@pytest.fixture(scope="module")
def played(tiny_folder, tiny_file):
    """What is known of the sensor, and eight records."""
    with open_session(tiny_folder, str(tiny_file), frames_per_second=50) as session:
        return Sight(session.about, rest_depth_mm(session.bundle)), list(session.records(frames=8))


@pytest.fixture
def page():
    view = PageView()
    yield view
    view.close()


def token(page: PageView) -> str:
    return parse_qs(urlsplit(page.url).query)["token"][0]


def get(page: PageView, path: str, **headers: str) -> http.client.HTTPResponse:
    place = urlsplit(page.url)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=WAIT_S)
    connection.request("GET", path, headers=headers)
    response = connection.getresponse()
    response.content = response.read()
    connection.close()
    return response


def browser(page: PageView, **headers: str):
    """A connection to the stream, as a browser's."""
    place = urlsplit(page.url)
    address = f"ws://{place.netloc}/stream?{place.query}"
    return connect(address, max_size=None, open_timeout=WAIT_S, proxy=None, additional_headers=headers)


def arrays(described: list[dict], octets: list[bytes]) -> dict[str, np.ndarray]:
    return {
        one["name"]: np.frombuffer(part, one["dtype"]).reshape(one["shape"])
        for one, part in zip(described, octets, strict=True)
    }


def received(connection) -> tuple[dict, dict, dict, dict]:
    """Facts, timing, what is drawn, and arrays of the next record."""
    topic, facts, timing, drawn, *octets = page_message.split(connection.recv(timeout=WAIT_S))
    assert topic == b"record"
    drawn = json.loads(drawn)
    return json.loads(facts), json.loads(timing), drawn, arrays(drawn["arrays"], octets)


class TestAccess:
    def test_it_listens_on_this_machine_alone_with_a_token_of_its_own(self, page):
        assert urlsplit(page.url).hostname == "127.0.0.1"
        other = PageView()
        other.close()
        assert len(token(page)) >= 32
        assert token(page) != token(other)

    def test_the_token_opens_the_page_and_its_cookie_the_files(self, page):
        response = get(page, f"/?token={token(page)}")
        assert response.status == 200
        assert b"<canvas" in response.content
        cookie = response.headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        for path, (_, kind) in FILES.items():
            found = get(page, path, Cookie=f"theme=dark; {cookie.split(';')[0]}")
            assert (found.status, found.headers["Content-Type"]) == (200, kind)
            assert found.headers["Content-Security-Policy"].startswith("default-src 'self'")
            assert b"http://" not in found.content  # it loads nothing from elsewhere
            assert b"https://" not in found.content

    @pytest.mark.parametrize("path", ["/", "/page.js", "/stream", "/nothing"])
    @pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", "?token=w%C3%B6rter"])
    def test_no_other_token_does(self, page, path, query):
        response = get(page, path + query)
        assert response.status == 403
        assert b"wrong token" in response.content
        assert get(page, path, Cookie=f"fastac-1={token(page)}").status == 403
        assert get(page, path, Cookie="fastac=; =,").status == 403

    @pytest.mark.parametrize(
        ("headers", "status"),
        [
            ({"Host": "evil.example"}, 403),
            ({"Host": "127.0.0.1.evil.example:80"}, 403),
            ({"Host": "[bad"}, 400),
            ({"Host": "localhost:1234"}, 200),  # as through a tunnel
            ({"Host": "192.168.1.2:80"}, 200),
            ({"Host": "[::1]:80"}, 200),
            ({"Origin": "http://evil.example"}, 403),
            ({"Host": "localhost:1", "Origin": "http://localhost:1"}, 200),
            ({"Host": "localhost:1", "Origin": "http://localhost:2"}, 403),
        ],
    )
    def test_requests_that_another_page_may_have_made(self, page, headers, status):
        assert get(page, f"/?token={token(page)}", **headers).status == status

    def test_files_beside_the_page_s_are_not_served(self, page):
        for path in ("/../page.py", "/page.py", "/page/index.html", "/index.html", "//etc/passwd"):
            assert get(page, f"{path}?token={token(page)}").status == 404

    def test_the_stream_needs_the_token_and_the_page_s_origin(self, page):
        place = urlsplit(page.url)
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{place.netloc}/stream?token=wrong", open_timeout=WAIT_S, proxy=None)
        with pytest.raises(InvalidStatus, match="403"):
            browser(page, Origin="http://evil.example")
        assert page.viewers == 0

    def test_a_port_in_use(self):
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
            with pytest.raises(PageError) as refused:
                PageView(port=port)
        assert str(refused.value).startswith(f"127.0.0.1:{port}: ")


class TestStream:
    def test_a_browser_gets_the_description_and_then_records(self, page, played):
        sight, records = played
        with browser(page) as connection:
            page.describe(sight)
            topic, about, drawn, rest = page_message.split(connection.recv(timeout=WAIT_S))
            drawn = json.loads(drawn)
            assert topic == b"about"
            assert json.loads(about)["scene"] == "tiny"
            np.testing.assert_array_equal(arrays(drawn["arrays"], [rest])["rest_mm"], sight.rest_depth_mm)
            np.testing.assert_allclose(drawn["x_mm"], sight.x_mm)
            page.add(records[0])
            facts, timing, drawn, images = received(connection)
        record = records[0]
        assert facts["force_n"] == record.force_n
        assert (facts["frame"], facts["suspect"], facts["reasons"]) == (
            0,
            record.suspect,
            list(record.reasons),
        )
        assert timing["host_latency_s"] == record.timing.host_latency_s
        np.testing.assert_array_equal(images["image"], record.image)
        np.testing.assert_array_equal(images["depth_mm"], record.depth_mm)
        np.testing.assert_array_equal(images["normals_rgb"], colours_of_normals(record.normals))
        assert drawn["deepest_mm"] == pytest.approx(float((sight.rest_depth_mm - record.depth_mm).max()))

    def test_what_a_browser_leaves_out_is_counted_but_its_curves_have_it(self, page, played):
        sight, records = played
        page.describe(sight)
        with browser(page) as connection:
            connection.recv(timeout=WAIT_S)
            page.add(records[0])
            assert received(connection)[0]["frame"] == 0
            for record in records[1:6]:  # the browser is still at the first
                page.add(record)
            connection.send("next")
            facts, _, drawn, _ = received(connection)
            assert facts["frame"] == 5
            assert (drawn["shown"], drawn["left_out"]) == (2, 4)
            rows = drawn["history"]
            assert [row[0] for row in rows] == pytest.approx([0.02, 0.04, 0.06, 0.08, 0.1])
            assert [row[1] for row in rows] == [[r.force_n["z"]] for r in records[1:6]]
        assert (page.sent, page.left_out) == (2, 4)
        assert page.first_picture_ns is not None

    def test_a_browser_that_comes_late_sees_the_newest_and_the_curves_before_it(self, page, played):
        sight, records = played
        page.describe(sight)
        for record in records[:4]:
            page.add(record)
        with browser(page) as connection:
            connection.recv(timeout=WAIT_S)
            facts, _, drawn, _ = received(connection)
        assert (facts["frame"], drawn["left_out"], len(drawn["history"])) == (3, 0, 4)

    def test_flags_and_lost_frames(self, page, played):
        sight, records = played
        page.describe(sight)
        lost = replace(records[1], lost=True, force_n={}, arrays={})
        lost = replace(lost, timing=replace(lost.timing, first_pixel_to_result_s=None, host_latency_s=None))
        page.add(replace(records[0], suspect=True, bad=True))
        page.add(lost)
        with browser(page) as connection:
            connection.recv(timeout=WAIT_S)
            facts, _, drawn, images = received(connection)
        assert facts["lost"]
        assert images == {}
        assert [row[3] for row in drawn["history"]] == [0b0110, 0b1000]  # suspect and bad; lost
        assert drawn["history"][1][1:3] == [[None], [None, None]]

    def test_several_browsers_and_none_that_holds_the_stream_up(self, page, played):
        sight, records = played
        page.describe(sight)
        with browser(page) as slow, browser(page) as quick:
            for connection in (slow, quick):
                connection.recv(timeout=WAIT_S)
            for record in records:
                page.add(record)  # nobody has taken any yet
            seen = 0
            while seen < records[-1].frame:
                seen = received(quick)[0]["frame"]
                quick.send("next")
            assert page.viewers == 2
            received(slow)

    def test_at_the_end_browsers_are_told(self, played):
        page = PageView()
        page.describe(played[0])
        with browser(page) as connection:
            connection.recv(timeout=WAIT_S)
            thread = threading.Thread(target=page.close)
            thread.start()
            with pytest.raises(ConnectionClosedOK):
                connection.recv(timeout=WAIT_S)
            thread.join(WAIT_S)
        assert not thread.is_alive()
        page.close()


def test_large_images_are_thinned(played):
    sight, records = played
    about = replace(sight.about, height_px=258, width_px=258)
    large = Sight(about, np.zeros((256, 256), np.float32))
    record = replace(
        records[0],
        arrays={
            "image": np.zeros((258, 258, 4), np.uint8),
            "depth_mm": np.arange(256 * 256, dtype=np.float32).reshape(256, 256),
        },
    )
    _, drawn, octets = page_message.of_record(large, record)
    found = arrays(drawn["arrays"], octets)
    np.testing.assert_array_equal(found["depth_mm"], record.depth_mm[::4, ::4])
    assert found["image"].shape == (86, 86, 4)
    description = json.loads(page_message.split(page_message.of_about(large))[2])
    assert len(description["x_mm"]) == len(description["y_mm"]) == 64
