import numpy as np
import pytest

from fastac.report.tables import Table, mean_and_spread, number, text_table


def test_a_table_as_text():
    text = Table("Title", ["a", "long head"], [["x", "1,000"]]).text
    assert text.splitlines() == ["Title", "  a      long head", "  x          1,000"]


def test_cells_are_shown_as_they_are_and_numbers_to_the_right():
    rows = [["depth", "0.0400", 7, None], ["a long name of a metric", "-12.5", 1234, "not placed: too large"]]
    head, first, second = text_table(["error", "mm", "count", "why"], rows).splitlines()
    assert head.split() == ["error", "mm", "count", "why"]
    assert first.split() == ["depth", "0.0400", "7"]
    assert second.split(maxsplit=8)[6:] == ["-12.5", "1234", "not placed: too large"]
    assert first.index("0.0400") + len("0.0400") == second.index("-12.5") + len("-12.5")


def test_no_column_is_cut_and_no_line_broken():
    wide = ["x" * 120, "y" * 120]
    assert text_table(["a", "b"], [wide]).splitlines()[1].split() == wide


def test_a_table_without_rows_is_its_head():
    assert text_table(["a", "b"], []).split() == ["a", "b"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0123456, "0.01235"), (12345, "12,345"), (12345.0, "12,345"), (True, "True"), ("x", "x")],
)
def test_numbers_have_four_digits_or_are_whole(value, text):
    assert number(value) == text


def test_the_spread_is_that_of_a_sample():
    assert mean_and_spread([1.0, 3.0]) == "2 ± 1.414"
    assert mean_and_spread(np.array([0.5, 1.5, 1.0]), 2, "+") == "+1.00 ± 0.50"
    assert mean_and_spread([1234.5], 0) == "1234"
