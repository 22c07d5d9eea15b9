"""The page in a real browser: what it paints and says is what the records are."""

import base64
import io
import time
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from headless_browser import chromium
from PIL import Image

from fastac.streaming.session import open_session
from fastac.streaming.views.page import PageView
from fastac.streaming.views.pictures import Sight, rest_depth_mm

pytestmark = pytest.mark.full
WAIT_S = 30
PIXELS = "return document.getElementById(arguments[0]).toDataURL('image/png').split(',')[1]"


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def played(tiny_folder, tiny_file):
    with open_session(tiny_folder, str(tiny_file), frames_per_second=50) as session:
        return Sight(session.about, rest_depth_mm(session.bundle)), list(session.records(frames=8))


@pytest.fixture
def page(played, browser):
    view = PageView()
    view.describe(played[0])
    browser.get(view.url)
    yield view
    view.close()


def until(browser, script: str, wanted) -> None:
    """Wait until a script gives what is wanted."""
    end = time.monotonic() + WAIT_S
    while (found := browser.execute_script(script)) != wanted:
        assert time.monotonic() < end, f"{found!r}: expected {wanted!r}; {browser.get_log('browser')}"
        time.sleep(0.02)


def text(browser, name: str) -> str:
    return browser.execute_script("return document.getElementById(arguments[0]).textContent", name)


def pixels(browser, name: str) -> np.ndarray:
    """(rows, columns, 4) uint8 of a canvas."""
    png = base64.b64decode(browser.execute_script(PIXELS, name))
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))


def show(browser, page, record) -> None:
    page.add(record)
    until(browser, "return document.getElementById('frame').textContent", str(record.frame))


def test_numbers_and_pictures_are_the_record_s(browser, page, played):
    sight, records = played
    record = records[0]
    show(browser, page, record)
    assert text(browser, "scene") == "tiny"
    force = record.force_n["z"]
    assert text(browser, "force-z") == f"{'−' if force < 0 else '+'}{abs(force):.3f}"
    assert text(browser, "deepest") == f"{(sight.rest_depth_mm - record.depth_mm).max():.3f}"
    assert text(browser, "hardware") == f"{1e3 * record.timing.first_pixel_to_result_s:.3f}"
    assert text(browser, "host") == f"{1e3 * record.timing.host_latency_s:.3f}"
    assert "simulated" in text(browser, "hardware-name")
    image = pixels(browser, "image")
    np.testing.assert_array_equal(image[..., :3], record.image[..., 2::-1])  # red, green, blue
    assert (image[..., 3] == 255).all()
    np.testing.assert_array_equal(pixels(browser, "nir")[..., 0], record.image[..., 3])
    for name in ("surface", "normals", "depth", "force-curve", "latency-curve", "flag-curve", "dial"):
        assert len(np.unique(pixels(browser, name).reshape(-1, 4), axis=0)) > 2, name
    painted = pixels(browser, "surface")[..., 3] == 255
    assert painted.mean() > 0.1  # the skin fills a good part of its canvas
    assert not [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def test_flags_are_shown_with_their_reasons(browser, page, played):
    _, records = played
    show(browser, page, replace(records[1], suspect=True, reasons=("change", "light")))
    state = browser.find_element("id", "status")
    assert (state.get_attribute("data-state"), state.text) == ("suspect", "suspect: change, light")
    lost = replace(records[2], lost=True, force_n={}, arrays={})
    show(browser, page, replace(lost, timing=replace(lost.timing, host_latency_s=None)))
    assert (state.get_attribute("data-state"), state.text) == ("lost", "lost")
    assert text(browser, "force-z") == "–"
    show(browser, page, replace(records[3], suspect=False, bad=False, reasons=()))
    assert (state.get_attribute("data-state"), state.text) == ("ok", "ok")


def test_a_paused_page_keeps_its_picture_and_goes_on_with_the_newest(browser, page, played):
    _, records = played
    show(browser, page, records[0])
    show(browser, page, records[1])
    browser.find_element("id", "pause").click()
    for record in records[2:6]:
        page.add(record)
    time.sleep(0.3)
    assert text(browser, "frame") == "1"
    browser.find_element("id", "pause").click()
    until(browser, "return document.getElementById('frame').textContent", "5")
    assert int(text(browser, "left-out")) >= 3


def test_turned_zoomed_narrow_and_dark(browser, page, played, tmp_path):
    from selenium.webdriver import ActionChains

    show(browser, page, played[1][0])
    before = pixels(browser, "surface")
    surface = browser.find_element("id", "surface")
    ActionChains(browser).drag_and_drop_by_offset(surface, 120, 30).perform()
    turned = pixels(browser, "surface")
    assert (before != turned).any()
    browser.find_element("id", "turn").click()
    np.testing.assert_array_equal(pixels(browser, "surface"), before)
    ground = "return getComputedStyle(document.body).backgroundColor"
    light = browser.execute_script(ground)
    browser.find_element("id", "theme").click()
    dark = browser.execute_script(ground)
    assert light != dark
    browser.find_element("id", "theme").click()
    assert browser.execute_script(ground) == light
    narrow = {"width": 400, "height": 900, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", narrow)
    try:
        until(browser, "return document.documentElement.scrollWidth", 400)  # nothing is cut off
        show(browser, page, played[1][1])
        assert pixels(browser, "surface").shape[1] < 500
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_end_and_a_wrong_token(browser, played):
    page = PageView()
    page.describe(played[0])
    browser.get(page.url)
    show(browser, page, played[1][0])
    page.close()
    until(browser, "return document.getElementById('status').textContent.trim()", "the stream has ended")
    assert text(browser, "frame") == "0"  # the last picture stays
    page = PageView()
    try:
        browser.get(page.url.partition("token=")[0] + "token=wrong")
        assert "wrong token" in browser.page_source
    finally:
        page.close()


def test_the_files_of_the_page_are_all_served():
    from fastac.streaming.views.page_access import FILES

    folder = files("fastac.streaming.views") / "page"
    assert {path.name for path in folder.iterdir()} == {name for name, _ in FILES.values()}
