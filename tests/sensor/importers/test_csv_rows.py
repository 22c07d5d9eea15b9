import math
import re
from dataclasses import dataclass, field

import pytest

from fastac.sensor.importers.csv_rows import COLUMN, Split, read_rows
from fastac.sensor.importers.footage import ImportFailure


@dataclass(frozen=True)
class Sample:
    name: str
    force_n: float
    count: int = 7
    split: Split | None = None
    offset_mm: float | None = math.nan


def read(tmp_path, text: str, **options):
    (tmp_path / "rows.csv").write_text(text)
    return read_rows(tmp_path / "rows.csv", Sample, **options)


def test_rows_are_typed_and_know_their_line(tmp_path):
    text = "force_n, name,split\n 1.5 ,ball,test\n\n-2,nut,train\n"
    assert [(row.name, row.force_n, row.count, row.split, line) for row, line in read(tmp_path, text)] == [
        ("ball", 1.5, 7, "test", 2),
        ("nut", -2.0, 7, "train", 4),
    ]


@dataclass(frozen=True)
class Contact:
    picture: str = field(metadata={COLUMN: ("picture", "photo")})
    radius_px: float = field(metadata={COLUMN: "radius (px)"})


def test_columns_of_several_names(tmp_path):
    for name in ("picture", "photo"):
        (tmp_path / "rows.csv").write_text(f"{name},radius (px)\na.png,3\n")
        assert read_rows(tmp_path / "rows.csv", Contact) == [(Contact("a.png", 3.0), 2)]
    for text, message in (
        ("image,radius (px)\na.png,3\n", "picture: missing column"),
        ("photo,radius (px)\n,3\n", "line 2: photo: missing value"),
        ("photo,picture,radius (px)\na,b,3\n", "'photo': unknown column; expected picture, radius"),
    ):
        (tmp_path / "rows.csv").write_text(text)
        with pytest.raises(ImportFailure, match=re.escape(message)):
            read_rows(tmp_path / "rows.csv", Contact)


def test_a_byte_order_mark_is_no_part_of_a_column(tmp_path):
    ((row, _),) = read(tmp_path, "\ufeffname,force_n\nball,1\n")
    assert row.name == "ball"


def test_other_columns_only_where_they_are_allowed(tmp_path):
    text = "name,force_n,colour\nball,1,red\n"
    assert len(read(tmp_path, text, others_allowed=True)) == 1
    with pytest.raises(
        ImportFailure, match=r"rows\.csv: 'colour': unknown column; expected name, force_n, co"
    ):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,force\nball,1\n", r"rows\.csv: 'force': unknown column; did you mean force_n\?"),
        ("name,weight\nball,1\n", r"rows\.csv: force_n: missing column"),
        ("name,force_n,force_n\nball,1,1\n", r"rows\.csv: force_n: column named twice"),
        ("name,force_n,count\nball,1,1.5\n", r"line 2: count = '1\.5': expected a whole number"),
        ("name,force_n\nball,1\nnut,inf\n", r"line 3: force_n = 'inf': expected a number"),
        ("name,force_n,offset_mm\nball,1,x\n", r"line 2: offset_mm = 'x': expected a number"),
        ("name,force_n,split\nball,1,dev\n", r"split = 'dev': expected one of train, validation, test$"),
        ("name,force_n\n ,1\n", r"line 2: name: missing value"),
        ("name,force_n\nball,1,2\n", r"line 2: 3 values: expected 2, one for each column"),
    ],
)
def test_errors_are_one_line_that_says_where_and_what(tmp_path, text, message):
    with pytest.raises(ImportFailure, match=message) as error:
        read(tmp_path, text)
    assert "\n" not in str(error.value)


def test_a_column_that_is_needed_may_not_be_absent(tmp_path):
    with pytest.raises(ImportFailure, match=r"rows\.csv: count: missing column"):
        read(tmp_path, "name,force_n\nball,1\n", needed=["count"])


@dataclass(frozen=True)
class Circle:
    name: str
    radius_mm: float = field(metadata={COLUMN: "radius(mm)"})


def test_a_column_may_have_a_name_that_is_none_in_python(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("name,radius(mm)\nball,2.5\n")
    assert read_rows(path, Circle) == [(Circle("ball", 2.5), 2)]
    for text, message in (
        ("name,radius_mm\nball,1\n", r"'radius_mm': unknown column; did you mean radius\(mm\)"),
        ("name,radius(mm)\nball,\n", r"line 2: radius\(mm\): missing value"),
        ("name,radius(mm)\nball,x\n", r"line 2: radius\(mm\) = 'x': expected a number"),
        ("name,radius(mm)\nball,inf\n", r"line 2: radius\(mm\) = 'inf': expected a number"),
    ):
        path.write_text(text)
        with pytest.raises(ImportFailure, match=message):
            read_rows(path, Circle)
