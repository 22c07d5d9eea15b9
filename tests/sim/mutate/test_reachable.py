"""Bounds of counters that are known by hand, found by several threads at once."""

from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("z3", reason="the extra `proof` is not installed: pip install -e '.[proof]'")

from fastac.sim.mutate.reachable import upper_bounds

SMT2 = """\
(declare-sort |m_s| 0)
(declare-fun |inner| (|m_s|) (_ BitVec 3))
(declare-fun |other| (|m_s|) (_ BitVec 3))
(define-fun |m_n count.q| ((state |m_s|)) (_ BitVec 3) (|inner| state))
(define-fun |m_n count.d| ((state |m_s|)) (_ BitVec 3)
  (ite (= (|inner| state) #b101) #b000 (bvadd (|inner| state) #b001)))
(define-fun |m_n free.q| ((state |m_s|)) (_ BitVec 3) (|other| state))
(define-fun |m_n free.d| ((state |m_s|)) (_ BitVec 3) (bvadd (|other| state) (|inner| state)))
"""


def test_a_counter_to_5_and_a_register_of_any_value():
    registers = {"count": (3, 0), "free": (3, 0)}
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: upper_bounds(SMT2, "m", registers), range(40)))
    assert found == [{"count": 5}] * 40


def test_a_start_above_what_the_counter_takes():
    assert upper_bounds(SMT2, "m", {"count": (3, 6), "free": (3, 0)}) == {}
