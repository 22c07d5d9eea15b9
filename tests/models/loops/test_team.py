"""Threads that help: the same ones each time, also after a fork, and what goes wrong in them."""

import os
import threading

import pytest

from fastac.models.loops import team
from fastac.models.loops.team import threads, together


def gathered(count: int, late_s: float = 0) -> dict[int, str]:
    """Which thread calls as which member, once all have."""
    found, all_there = {}, threading.Event()

    def work(member: int) -> None:
        found[member] = threading.current_thread().name
        if len(found) == count:
            all_there.set()
        if member == 0:
            assert all_there.wait(60)

    together(work, count)
    return found


@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_same_threads_are_the_same_members(count):
    first, again = gathered(count), gathered(count)
    assert first == again
    assert sorted(first) == list(range(count))
    assert first[0] == threading.current_thread().name
    assert len(set(first.values())) == count


def test_helpers_survive_what_goes_wrong_in_them():
    called = threading.Event()

    def fail(member: int) -> None:
        if member:
            called.set()
            raise ZeroDivisionError
        assert called.wait(60)

    together(fail, 2)
    with pytest.raises(ZeroDivisionError):
        together(lambda member: 1 // member, 2)
    assert len(gathered(2)) == 2


def test_a_call_may_begin_when_the_first_is_over():
    called = []
    gathered(2)
    busy, free = threading.Event(), threading.Event()
    together(lambda member: member and (busy.set(), free.wait(60)), 2)
    assert busy.wait(60)
    together(called.append, 2)
    assert called == [0]
    free.set()
    gathered(2)
    assert called == [0, 1]


def test_a_forked_process_has_helpers_of_its_own():
    gathered(2)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(write, b"2" if len(gathered(2)) == 2 and len(team._helpers) == 1 else b"0")
        finally:
            os._exit(0)
    os.close(write)
    assert os.read(read, 1) == b"2"
    os.waitpid(child, 0)


@pytest.mark.parametrize(("stated", "expected"), [("1", 1), ("2", 2), ("0", 3), ("many", 3), ("", 3)])
def test_the_environment_limits_the_threads(monkeypatch, stated, expected):
    monkeypatch.setattr(team, "CORES", 3)
    monkeypatch.setenv("OMP_NUM_THREADS", stated)
    assert threads() == expected
