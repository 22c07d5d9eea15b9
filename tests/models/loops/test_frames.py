import threading

import numpy as np
import pytest

from fastac.models.loops import team
from fastac.models.loops.frames import CHUNK, IdleWorkers, choose_outputs, over_frames, require_frames

OUTPUTS = {"double": ((2,), np.int64), "index": ((), np.int32)}


@pytest.fixture(autouse=True)
def no_limit(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)


class Worker:
    """Doubles frames of two numbers, and records the thread and the number of frames of each call."""

    def __init__(self, made: list):
        self.thread, self.sizes = threading.get_ident(), []
        made.append(self)

    def __call__(self, frames, out):
        assert threading.get_ident() == self.thread
        self.sizes.append(len(frames))
        out["double"][...] = 2 * frames
        out["index"][...] = frames[:, 0]


def run(count: int, worker):
    frames = np.stack([np.arange(count), -np.arange(count)], axis=1)
    return frames, over_frames(worker, frames, OUTPUTS, progress=False, label="test")


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("count", [1, 2, CHUNK, 5 * CHUNK + 3])
def test_every_frame_has_its_place(monkeypatch, threads, count):
    monkeypatch.setattr(team, "CORES", threads)
    made: list[Worker] = []
    frames, found = run(count, lambda: Worker(made))
    np.testing.assert_array_equal(found["double"], 2 * frames)
    np.testing.assert_array_equal(found["index"], np.arange(count))
    assert found["index"].dtype == np.int32
    sizes = [size for worker in made for size in worker.sizes]
    assert sum(sizes) == count
    assert max(sizes) <= CHUNK
    assert 1 <= len(made) <= min(threads, count)


def test_few_frames_are_shared_out(monkeypatch):
    monkeypatch.setattr(team, "CORES", 3)
    made: list[Worker] = []
    run(7, lambda: Worker(made))
    assert sorted(size for worker in made for size in worker.sizes) == [1, 3, 3]


class Sharer(Worker):
    """One that threads can share: it notes with how many it is called."""

    can_share = True

    def __init__(self, made: list):
        super().__init__(made)
        self.shared = []

    def __call__(self, frames, out, threads=1):
        super().__call__(frames, out)
        if threads > 1:
            self.shared.append((len(frames), threads))


@pytest.mark.parametrize(
    ("count", "shared"), [(1, [(1, 4)]), (3, [(3, 4)]), (4, []), (9, [(1, 4)]), (40, [])]
)
def test_what_is_left_over_is_shared(monkeypatch, count, shared):
    monkeypatch.setattr(team, "CORES", 4)
    made: list[Sharer] = []
    frames, found = run(count, lambda: Sharer(made))
    np.testing.assert_array_equal(found["double"], 2 * frames)
    assert [each for worker in made for each in worker.shared] == shared


def test_one_thread_shares_nothing(monkeypatch):
    monkeypatch.setattr(team, "CORES", 1)
    made: list[Sharer] = []
    for count in (1, 3, 40):
        frames, found = run(count, lambda: Sharer(made))
        np.testing.assert_array_equal(found["double"], 2 * frames)
    assert not any(worker.shared for worker in made)


def test_idle_workers_are_lent_again():
    idle, made = IdleWorkers(), []

    def make(outputs):
        made.append(outputs)
        return object()

    one, other = frozenset(["double"]), frozenset(["index"])
    with idle.lent(make, one) as worker:
        first, second = worker(), worker()
    with idle.lent(make, one) as worker, idle.lent(make, one) as beside:
        assert {worker(), beside()} == {first, second}
    with idle.lent(make, other) as worker:
        worker()
    assert made == [one, one, other]

    def interrupted():
        with idle.lent(make, other) as worker:
            worker()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        interrupted()
    with idle.lent(make, other) as worker:
        worker()
    assert made == [one, one, other, other]


def test_what_goes_wrong_in_a_thread_is_raised():
    def worker():
        def refuse(frames, out):
            raise ZeroDivisionError(f"{len(frames)}")

        return refuse

    with pytest.raises(ZeroDivisionError):
        run(40, worker)


def test_no_frames():
    with pytest.raises(ValueError, match="frames: none to process"):
        run(0, lambda: Worker([]))


def test_choose():
    assert choose_outputs(OUTPUTS, None) == OUTPUTS
    assert choose_outputs(OUTPUTS, ("index",)) == {"index": ((), np.int32)}
    with pytest.raises(ValueError, match="wanted 'depth_mm': expected some of double, index"):
        choose_outputs(OUTPUTS, iter(["index", "depth_mm"]))


def test_require_frames():
    background = np.zeros((4, 5, 3), np.uint8)
    require_frames(np.zeros((7, 4, 5, 3), np.uint8), background)
    with pytest.raises(ValueError, match=r"frames \(7, 5, 4, 3\) uint8: expected \(4, 5, 3\) uint8 each"):
        require_frames(np.zeros((7, 5, 4, 3), np.uint8), background)
    with pytest.raises(ValueError, match=r"float32: expected \(4, 5, 3\)"):
        require_frames(np.zeros((7, 4, 5, 3), np.float32), background)
