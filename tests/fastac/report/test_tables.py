import pytest

from fastac.report.tables import Table, number


def test_a_table_as_text():
    text = Table("Title", ["a", "long head"], [["1,000", "x"]]).text
    assert text.splitlines() == ["Title", "  a      long head", "  1,000  x"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0123456, "0.01235"), (12345, "12,345"), (12345.0, "12,345"), (True, "True"), ("x", "x")],
)
def test_numbers_have_four_digits_or_are_whole(value, text):
    assert number(value) == text
