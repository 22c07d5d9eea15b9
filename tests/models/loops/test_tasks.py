"""Tasks of a team: each is done once, by whoever is there, and later phases wait for earlier ones."""

import threading
import time

import numpy as np
import pytest
from numba import njit

from fastac.models.loops.tasks import BELL, begin, done, linger, new_board, take, tasks, wait

FIRST, SECOND = 0, 1


@njit(nogil=True)
def both_phases(board, member, by, sums):
    """Each task of the first phase writes who did it; each of the second adds all of the first up."""
    task = take(board, FIRST, member)
    while task < tasks(board, FIRST):
        by[task] += 1 + member
        done(board, FIRST)
        task = take(board, FIRST, member)
    wait(board, FIRST)
    task = take(board, SECOND, member)
    while task < tasks(board, SECOND):
        for k in range(len(by)):
            sums[task] += by[k] > 0
        done(board, SECOND)
        task = take(board, SECOND, member)


@pytest.mark.parametrize("count", [0, 1, 5, 64])
@pytest.mark.parametrize("members", [1, 2, 3, 7])
@pytest.mark.parametrize("present", ["all", "first", "last"])
def test_every_task_is_done_once(members, count, present):
    """Whether all members come, or only one."""
    board, by, sums = new_board(members, count, 9), np.zeros(count, np.int64), np.zeros(9, np.int64)
    who = {"all": range(members), "first": [0], "last": [members - 1]}[present]
    team = [threading.Thread(target=both_phases, args=(board, member, by, sums)) for member in who]
    for thread in team:
        thread.start()
    for thread in team:
        thread.join()
    assert (sums == count).all(), "the second phase began when all of the first was done"
    assert ((by >= 1) & (by <= members)).all()
    assert (board[:, 1, 0] == [count, 9]).all()
    both_phases(board, 0, by, sums)  # late: nothing is left
    assert (sums == count).all()


def test_a_member_takes_its_own_share_first():
    board = new_board(3, 9)

    @njit
    def taken(board, member):
        return [take(board, 0, member) for _ in range(5)]

    assert taken(board, 1) == [3, 4, 5, 6, 7]
    assert taken(board, 0) == [0, 1, 2, 8, 9]
    assert taken(board, 2) == [9] * 5


def test_who_lingers_leaves_when_the_next_frame_is_begun():
    board, other = new_board(2, 1), new_board(2, 1)
    begin(board, 0, BELL)
    begin(board, 1, BELL)  # does nothing
    before = BELL[0, 0, 0]
    linger(board, 0, BELL)  # member 0 does not
    linger(board, 1, BELL)  # ends by itself
    begin(other, 0, BELL)
    assert BELL[0, 0, 0] == before + 1
    started = time.perf_counter()
    for _ in range(1000):
        linger(board, 1, BELL)  # at once: another frame was begun
    assert time.perf_counter() - started < 60
