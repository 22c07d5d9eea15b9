"""Goals as a table and for the top of the page."""

from fastac.studies.reproduce.goals import headlines, table

FOUND = [
    {"what": "depth MAE", "unit": "mm", "ours": 0.0123456, "at_most": 0.02, "reached": True},
    {"what": "gain", "unit": "times", "ours": 2.0, "at_least": 3, "reached": False},
]


def test_each_goal_with_what_was_reached():
    assert table(FOUND).rows == [
        ["depth MAE", "0.01235", "≤ 0.02", "mm", "reached"],
        ["gain", "2", "≥ 3", "times", "NOT reached"],
    ]
    first, second = headlines(FOUND)
    assert (first.label, first.value, first.note) == ("depth MAE", "0.01235 mm", "goal ≤ 0.02: reached")
    assert (second.value, second.note) == ("2 times", "goal ≥ 3: NOT reached")
