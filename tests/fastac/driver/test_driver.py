"""One suite for all transports: emulator, simulated hardware, and stand-ins for UIO and PYNQ."""

import asyncio
import threading

import numpy as np
import pytest

from fastac.driver import asynchronous
from fastac.driver.driver import Driver, DriverError
from fastac.driver.packets import join
from fastac.driver.transports.transport import DmaError, PacketSizeError, TransportTimeout
from fastac.gateware.calibration import calibration_words
from fastac.models.emulator.pipeline import Emulator


def assert_equal(found, expected, k):
    """All that the hardware found in a frame, raw and in units."""
    assert not found.lost
    assert found.force_raw.tolist() == expected.force_raw[k].tolist()
    np.testing.assert_array_equal(found.words("depth")[..., 0], expected.depth_words[k])
    np.testing.assert_allclose(found.force_n, expected.force_n[k], rtol=1e-12)
    np.testing.assert_allclose(found.depth_mm, expected.depth_mm[k][1:-1, 1:-1], atol=1e-6)
    assert int(found.records["validity"]) == expected.validity[k]
    assert bool(found.suspect) == bool(expected.validity[k])
    assert not found.bad


def test_results_are_the_emulator_s(driver, frames, expected):
    before = driver.registers.read("FRAME_COUNT")
    results = list(driver.frames(frames))
    for k, found in enumerate(results):
        assert_equal(found, expected, k)
        assert found.frame == before + k + 1
        assert found.force_axes == ("x", "y", "z")
    times = [float(found.time_s) for found in results]
    assert times == sorted(times)
    assert all(found.host_latency_s > 0 for found in results)
    assert driver.counts.received == driver.counts.sent == len(frames)
    assert not driver.counts.lost
    assert not driver.counts.stale
    # The last frame is noise: the reasons and the sticky errors have names.
    assert {"change", "detail"} <= set(results[-1].reasons)
    assert "frame_suspect" in results[-1].errors
    assert driver.counts.errors["frame_suspect"] >= 1


def test_one_frame_at_a_time_and_batches_are_the_same(driver, frames, expected):
    singly = join(list(driver.frames(frames, in_flight=1)))
    batches = list(driver.batches(frames, 3))
    assert [len(batch) for batch in batches] == [3, 3, 2]
    for name in ("force_raw", "depth_mm", "bad", "suspect"):
        together = np.concatenate([getattr(batch, name) for batch in batches])
        np.testing.assert_array_equal(getattr(singly, name), together)
    np.testing.assert_array_equal(singly.force_raw, expected.force_raw)
    assert batches[1][2].frame == singly.frame[-1] + 6
    assert np.all(np.diff(batches[1].time_s) >= 0)


def test_one_frame_at_a_time_does_not_wait_for_the_next(driver, frames):
    """A camera's next frame may come much later than the result."""
    given = []

    def camera():
        for k, frame in enumerate(frames[:3]):
            given.append(k)
            yield frame

    for k, _ in enumerate(driver.frames(camera(), in_flight=1)):
        assert given == list(range(k + 1))


def test_identity(transport, description):
    transport_version = description.model_copy(update={"version": description.version + 1})
    with pytest.raises(DriverError, match=rf"VERSION = {description.version}: hardware.json is of version"):
        Driver(transport, transport_version)
    other = description.model_copy(update={"bundle_sha256": "0" * 64})
    with pytest.raises(DriverError, match=r"BUNDLE_HASH = .*: hardware.json is of bundle 0{16};"):
        Driver(transport, other)
    Driver(transport, other, any_bundle=True)


def test_background(driver, bundle, frames):
    driver.capture_background(frames[2])
    expected = Emulator(bundle.pipeline.replace(background=frames[2])).run(frames)
    for k, found in enumerate(driver.frames(frames)):
        assert_equal(found, expected, k)
    driver.capture_background(bundle.pipeline.background)


@pytest.mark.parametrize("name", ["emulator", "simulation", "pynq"])
def test_calibration(opened, name, description, bundle, recalibrated, frames, expected):
    """Not over files, which cannot tell a register that is written twice with the same value."""
    words = calibration_words(recalibrated, bundle)
    with opened(name) as transport:
        driver = Driver(transport, description)
        with pytest.raises(ValueError, match=rf"calibration: 7 words: the hardware takes {len(words)}"):
            driver.load_calibration(words[:7])
        with pytest.raises(ValueError, match=r"calibration: layout 0x.*: the hardware's is 0x"):
            driver.load_calibration(words ^ np.uint32(1))
        driver.load_calibration(words)
        assert driver.bundle_hash == recalibrated.hash_word
        with pytest.raises(DriverError, match="load its calibration"):
            driver.check_bundle()
        results = Emulator(recalibrated.pipeline).run(frames)
        assert (results.force_raw != expected.force_raw).any()
        for k, found in enumerate(driver.frames(frames)):
            assert_equal(found, results, k)
        driver.load_calibration(calibration_words(bundle, bundle))
        driver.check_bundle()
        for k, found in enumerate(driver.frames(frames)):
            assert_equal(found, expected, k)


class Faulty:
    """A transport that does something else instead of its n-th `receive`."""

    def __init__(self, transport, n, fault):
        self._transport, self._n, self._fault = transport, n, fault

    def __getattr__(self, name):
        return getattr(self._transport, name)

    def receive(self, stream, timeout_s):
        self._n -= 1
        if self._n == 0:
            if isinstance(self._fault, Exception):
                raise self._fault
            self._transport.receive(stream, timeout_s)  # a packet that nobody gets
        return self._transport.receive(stream, timeout_s)


@pytest.mark.parametrize(
    ("fault", "count"),
    [
        (TransportTimeout("depth: no packet"), "timeouts"),
        (DmaError("axi_dma_0 S2MM: DMA error: slave"), "dma_errors"),
        ("a lost packet", "missing"),
    ],
    ids=["timeout", "dma", "missing"],
)
def test_after_a_failure_frames_go_on(transport, description, frames, expected, fault, count):
    driver = Driver(Faulty(transport, 4, fault), description)
    results = list(driver.frames(frames))
    assert len(results) == len(frames)
    for k, found in enumerate(results):
        if found.lost:
            assert np.isnan(found.received_s)
        else:
            assert_equal(found, expected, k)
    lost = [k for k, found in enumerate(results) if found.lost]
    first = lost[0]  # the fourth packet, or the third where the frame of a restart came before
    in_flight = min(transport.frames_in_flight, len(frames) - first)
    assert first in (2, 3)
    assert lost == ([first] if count == "missing" else list(range(first, first + in_flight)))
    assert getattr(driver.counts, count) == 1
    assert driver.counts.lost == len(lost)
    assert driver.trouble
    # And once more, with nothing wrong.
    for k, found in enumerate(driver.frames(frames)):
        assert_equal(found, expected, k)


class CutOff(Faulty):
    """Loses the n-th frame, and gives the rest of a packet while the first frame after a reset is sent."""

    def __init__(self, transport, n):
        super().__init__(transport, 0, None)
        self._sends, self._rests = n, 0

    def reset_dma(self):
        self._transport.reset_dma()
        self._rests = 2

    def send(self, frame):
        self._sends -= 1
        if self._sends == 0:
            return
        if self._rests:
            self._rests -= 1
            raise PacketSizeError("depth: a packet of 8 bytes: expected more")
        self._transport.send(frame)

    def receive(self, stream, timeout_s):
        if self._sends == 0:
            self._sends = -1
            raise TransportTimeout("depth: no packet")
        return self._transport.receive(stream, timeout_s)


def test_the_rest_of_a_packet_that_comes_while_a_frame_is_sent(driver, frames, expected):
    """It comes to memory by itself, so any look at the DMAs may find it."""
    cut = CutOff(driver.transport, 1)
    driver.transport, driver._receiver._transport = cut, cut
    lost, *others = driver.frames(frames, in_flight=1)
    assert lost.lost
    for k, found in enumerate(others, 1):
        assert_equal(found, expected, k)
    assert driver.counts.stale >= 2
    assert driver.counts.dma_errors == 0


def test_a_background_that_is_lost_on_its_way(driver, bundle, frames):
    """The frame of zeros after the reset does not take its place."""
    cut = CutOff(driver.transport, 1)
    driver.transport, driver._receiver._transport = cut, cut
    assert not driver.capture_background(frames[2]).lost
    assert driver.counts.lost == 1
    expected = Emulator(bundle.pipeline.replace(background=frames[2])).run(frames)
    for k, found in enumerate(driver.frames(frames)):
        assert_equal(found, expected, k)
    driver.capture_background(bundle.pipeline.background)


def test_zeros_do_not_become_the_background(driver, bundle, frames):
    """A reset between the request and its frame."""
    driver._control(capture_background=1)
    driver.soft_reset()
    list(driver.frames([bundle.pipeline.background]))
    expected = Emulator(bundle.pipeline).run(frames)
    for k, found in enumerate(driver.frames(frames)):
        assert_equal(found, expected, k)


def test_an_iteration_that_is_left_leaves_nothing_behind(driver, frames, expected):
    for _ in driver.frames(frames):
        break
    for k, found in enumerate(driver.frames(frames)):
        assert_equal(found, expected, k)


def test_soft_reset_between_frames(driver, frames, expected):
    list(driver.frames(frames[:2]))
    driver.soft_reset()
    for k, found in enumerate(driver.frames(frames)):
        assert_equal(found, expected, k)


def test_a_second_driver_goes_on_where_the_first_one_stopped(transport, description, frames, expected):
    *_, third = Driver(transport, description).frames(frames[:3])
    last = int(third.frame)
    second = Driver(transport, description)
    for k, found in enumerate(second.frames(frames)):
        assert_equal(found, expected, k)
        assert found.frame == last + 2 + k  # between them a frame of zeros, see `Driver._restart`


def test_threads_read_registers_while_frames_run(driver, frames, expected):
    stop, wrong = threading.Event(), []
    shown = driver.registers.read("GEOMETRY")

    def watch():
        while not stop.is_set():
            if driver.registers.read("GEOMETRY") != shown or driver.registers.fields("STATUS")["loading"]:
                wrong.append(1)

    threads = [threading.Thread(target=watch) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        for k, found in enumerate(driver.frames(frames)):
            assert_equal(found, expected, k)
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert not wrong


def test_frames_run_once_at_a_time(driver, frames):
    running = driver.frames(frames)
    next(running)
    with pytest.raises(DriverError, match="running already"):
        next(driver.frames(frames))
    with pytest.raises(DriverError, match="running already"):
        driver.soft_reset()
    running.close()
    driver.soft_reset()


@pytest.mark.parametrize("kind", ["list", "asynchronous"])
def test_asyncio(driver, frames, expected, kind):
    async def camera():
        for frame in frames:
            await asyncio.sleep(0)
            yield frame

    async def main():
        source = camera() if kind == "asynchronous" else frames
        return [found async for found in asynchronous.frames(driver, source)]

    results = asyncio.run(main())
    assert len(results) == len(frames)
    for k, found in enumerate(results):
        assert_equal(found, expected, k)


def test_asyncio_s_loop_goes_on_while_the_driver_waits(driver, frames):
    """The camera's first frame comes when another task of the loop has run."""
    begun = threading.Event()

    def camera():
        assert begun.wait(timeout=60)
        yield from frames[:2]

    async def main():
        asyncio.get_running_loop().call_later(0.01, begun.set)
        return [found async for found in asynchronous.frames(driver, camera())]

    assert len(asyncio.run(main())) == 2


def test_frames_of_another_shape(driver, frames):
    with pytest.raises(ValueError, match=r"frame \(16, 16\) uint8: expected \(16, 16, 3\) uint8"):
        list(driver.frames([frames[0, ..., 0]]))
    with pytest.raises(ValueError, match=r"frame \(16, 16, 3\) int64: expected \(16, 16, 3\) uint8"):
        list(driver.frames([frames[0].astype(np.int64)]))
    assert len(list(driver.frames(frames))) == len(frames)
