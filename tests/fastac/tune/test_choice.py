import numpy as np
import pytest

from fastac.tune import choice


def errors_of(table, folds=5):
    """Errors by candidate and pair from a table (candidates, folds): the same whatever else is left out."""
    every = [pair for rung in choice.pairs(folds) for pair in rung]
    return {(c, pair): {k: row[k] for k in pair} for c, row in enumerate(table) for pair in every}, every


@pytest.mark.parametrize("folds", [3, 4, 5, 7])
def test_pairs(folds):
    rungs = choice.pairs(folds)
    every = [pair for rung in rungs for pair in rung]
    assert len(set(every)) == len(every) == folds * (folds - 1) // 2
    assert all(sum(k in pair for pair in rungs[0]) == 2 for k in range(folds))


def test_an_outer_fold_has_no_part_in_its_choice():
    """Whatever the errors on a fold are, the order of the candidates for it stays the same."""
    table = np.random.default_rng(1).uniform(1, 2, (6, 5))
    before, used = errors_of(table)
    for outer in range(5):
        changed = table.copy()
        changed[:, outer] = np.random.default_rng(2).uniform(0, 9, 6)
        after, _ = errors_of(changed)
        order = choice.ranked(before, range(6), outer, used)
        assert choice.ranked(after, range(6), outer, used) == order
        others = np.delete(table, outer, axis=1).mean(axis=1)
        assert order == sorted(range(6), key=lambda c: others[c])


def test_survivors_are_the_best_of_any_outer_fold():
    table = np.full((7, 5), 2.0)
    table[3] = 1.0
    table[5] = [9, 1.2, 1.2, 1.2, 1.2]  # good for outer fold 0 alone
    errors, used = errors_of(table)
    assert choice.survivors(errors, range(7), 5, used) == {0, 1, 3, 5}
    failed, _ = errors_of(np.full((3, 5), np.inf))
    assert choice.ranked(failed, range(3), None, used) == [0, 1, 2]


def test_what_data_cannot_tell_apart():
    rng = np.random.default_rng(3)
    table = 1 + 0.1 * rng.standard_normal((2, 5))
    table = np.vstack([table, table[0] + 0.5, np.full(5, np.inf)])
    errors, used = errors_of(table)
    found = choice.indistinguishable(errors, range(4), used)
    assert {2, 3}.isdisjoint(found)
    assert found[0] == int(table[:2].mean(axis=1).argmin())
    assert choice.indistinguishable(errors, [0], used) == [0]


def test_score():
    units = [{"a": 1.0, "b": 2.0}, {"a": 3.0, "b": 6.0}]
    assert choice.score(units, ["a"]) == pytest.approx(2)
    assert choice.score(units, ["a", "b"]) == pytest.approx(8**0.5)
    assert choice.score([{"a": 0.0}], ["a"]) == pytest.approx(0)
    assert choice.score([*units, {"b": 2.0}], ["a"]) == pytest.approx(2), "units without it do not count"
