"""The same integers with one frame as with many, by any number of threads, and for any number of callers."""

import threading

import numpy as np
import pytest

from fastac.models import random_bundle
from fastac.models.emulator import direct
from fastac.models.emulator.pipeline import Emulator

DEPTH, Z, XYZ, SLIP = "depth", "force_z", "force_xyz", "slip"
CASES = {
    "transforms": ((DEPTH, Z), {"size": 33, "channels": "bgr+nir"}),
    "recurrences": (
        (DEPTH, XYZ),
        {"size": 34, "solver": "tridiagonal", "kernel": "collapsed", "coverage": 0.9},
    ),
    "slopes": ((XYZ,), {"size": 35, "solver": "adjoint", "coverage": 0.9}),
    "dots": (
        (DEPTH, Z, SLIP),
        {"size": 36, "dots": True, "clamp": False, "bridge_dots": True, "coverage": 0.9},
    ),
    "two bands": ((DEPTH, Z), {"size": 16}),
    "normals": (("normals",), {"size": 17}),
}
BY_CASE = pytest.mark.parametrize("name", CASES)


@pytest.fixture
def emulator(tmp_path, name) -> Emulator:
    outputs, settings = CASES[name]
    scene = random_bundle.scene(outputs, **settings)
    return Emulator(random_bundle.random_bundle(tmp_path / "b", scene, hidden=(7, 5)).pipeline)


def loop(emulator: Emulator, frames: np.ndarray) -> dict[str, np.ndarray]:
    found = {n: np.empty((len(frames), *shape), kind) for n, (shape, kind) in emulator.outputs.items()}
    direct.loop(emulator.pipeline, frames, found)
    return found


def check(found, expected: dict[str, np.ndarray], part: slice) -> None:
    for name, values in expected.items():
        assert getattr(found, name).tobytes() == values[part].tobytes(), name


@BY_CASE
def test_any_number_of_threads(emulator, monkeypatch):
    frames = random_bundle.frames(emulator.pipeline.background, (3, 12, 40, 255, 20, 8, 90))
    expected = loop(emulator, frames)
    for threads in (1, 2, 3, 7):
        monkeypatch.setenv("OMP_NUM_THREADS", str(threads))
        check(emulator.run(frames), expected, slice(None))
        for k in range(len(frames)):
            check(emulator.run(frames[k : k + 1]), expected, slice(k, k + 1))
        check(emulator.run(frames[:3]), expected, slice(3))


@pytest.mark.parametrize("name", ["recurrences"])
def test_intervals_alone(emulator):
    """Whatever else is found beside them."""
    frames = random_bundle.frames(emulator.pipeline.background, (3, 40, 255))
    expected = loop(emulator, frames)
    assert (expected["force_half_width_n"] > 0).all()
    for wanted in (["force_half_width_raw"], ["force_half_width_n", "force_n"]):
        found = emulator.run(frames, wanted=wanted)
        check(found, {name: expected[name] for name in wanted}, slice(None))
        assert found.validity_measures is None


@pytest.mark.parametrize("name", ["transforms", "slopes", "dots"])
def test_several_callers_at_once(emulator, monkeypatch):
    """Each with frames of its own, one by one or several, beside each other on the same emulator."""
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    frames = random_bundle.frames(emulator.pipeline.background, (3, 12, 40, 255) * 3)
    expected, wrong = loop(emulator, frames), []

    def call(first: int) -> None:
        try:
            for turn in range(20):
                k = (first + turn) % (len(frames) - 1)
                part = slice(k, k + 1 + turn % 2)
                check(emulator.run(frames[part]), expected, part)
        except BaseException as error:
            wrong.append(error)

    callers = [threading.Thread(target=call, args=(2 * k,)) for k in range(5)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert not wrong


@pytest.mark.parametrize("name", ["transforms", "dots"])
def test_frames_of_any_kind_of_memory(emulator):
    frames = random_bundle.frames(emulator.pipeline.background, (3, 40))
    expected = loop(emulator, frames)
    kept = frames.copy()
    kept.flags.writeable = False
    spread = np.zeros((4, *frames.shape[1:3], 8), np.uint8)[::2, ..., : frames.shape[3]]
    spread[...] = frames
    unaligned = np.zeros(frames.nbytes + 1, np.uint8)[1:].reshape(frames.shape)
    unaligned[...] = frames
    for given in (kept, spread, unaligned, np.moveaxis(np.moveaxis(frames, 2, 1).copy(), 1, 2)):
        check(emulator.run(given), expected, slice(None))
        check(emulator.run(given[1:]), expected, slice(1, 2))
