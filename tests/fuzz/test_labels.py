"""Damaged CSV files: labels of photographs, readings of a force gauge, poses of a machine."""

import fuzzing
import pytest
from fuzzing import Reader
from hypothesis import strategies as st
from mutations import changed_bytes

from fastac.sensor.importers import ball_press, force_labels, poses
from fastac.sensor.importers.csv_rows import read_rows
from fastac.sensor.importers.footage import Video

LABELS = b"""\
image,center_x_px,center_y_px,radius_px,split
a.png,20.5,18,6,train
b.png,21,17.25,5.5,validation
c.png,19,16,4,test
"""
FORCES = b"""\
frame,force_z_n,group,force_x_n,force_y_n,split
0,0,pear,0,0,train
1,1.5,pear,0.1,-0.1,validation
2,2.5,plum,0.2,0,test
"""
POSES = b"""\
split,index,x_mm,y_mm,z_mm,load_n,tangential_x_n,tangential_y_n,force_x_n,force_y_n,force_z_n
train,0,0.1,-0.1,2.8,0.5,0,0,0.01,0.02,0.5
test,1,0.2,-0.2,2.7,1,0.3,0,0.3,0,1.0
"""
FRAGMENTS = (
    *(b",", b"\n", b"\r", b"\r\n", b'"', b'""', b";", b"\xef\xbb\xbf", b"\xff", b"\xed\xa0\x80", b"\x00"),
    *(
        b"nan",
        b"inf",
        b"-inf",
        b"1e999",
        b"-1e308",
        b"-0",
        b"1_0",
        "٣".encode(),
        "²".encode(),
        b"0x10",
        b"9" * 5000,
    ),
    *(
        b"x" * 140_000,
        b"," * 2000,
        b"../../../../etc/hostname",
        b"train",
        b" ",
        b"\t",
        b"frame",
        b"index",
        b"split",
    ),
)
CELLS = (
    *(
        "",
        " ",
        "0",
        "1",
        "-1",
        "2",
        "1.5",
        "nan",
        "inf",
        "1e308",
        "1e-320",
        "9" * 30,
        "9" * 5000,
        "x",
        "train",
        "test",
    ),
    *(
        "validation",
        "a.png",
        "../a.png",
        "/etc/hostname",
        "a\x00b",
        "\x85",
        '"',
        "é",
        "٣",
        "²",
        "1_0",
        "0b1",
        "+1",
    ),
)


@st.composite
def tables(draw, sample: bytes) -> bytes:
    """A table of which cells, rows or columns were changed."""
    rows = [line.split(",") for line in sample.decode().splitlines()]
    for _ in range(draw(st.integers(1, 3))):
        row = draw(st.integers(0, len(rows) - 1))
        column = draw(st.integers(0, max(len(rows[row]) - 1, 0)))
        match draw(st.integers(0, 6)):
            case 0 | 1 | 2 if rows[row]:
                rows[row][column] = draw(st.sampled_from(CELLS))
            case 3:
                rows[row : row + 1] = []
            case 4:
                rows[row:row] = [rows[row]]
            case 5:
                rows = [cells[:column] + cells[column + 1 :] for cells in rows]
            case _:
                rows = [[*cells, draw(st.sampled_from(CELLS))] for cells in rows]
        if not rows:
            break
    ending = draw(st.sampled_from(("\n", "\r\n", "\r")))
    return ending.join(",".join(cells) for cells in rows).encode()


def files(sample: bytes) -> st.SearchStrategy[dict]:
    both = tables(sample).flatmap(lambda text: changed_bytes([text], FRAGMENTS))
    texts = st.one_of(tables(sample), changed_bytes([sample], FRAGMENTS), both)
    return texts.map(lambda text: {"labels.csv": text})


READERS = [
    Reader(
        "labels of photographs",
        files(LABELS),
        lambda folder: read_rows(folder / "labels.csv", ball_press.Label, others_allowed=True),
    ),
    Reader(
        "readings of a force gauge",
        files(FORCES),
        lambda folder: force_labels.read(folder / "labels.csv", Video(folder / "press.mp4")),
    ),
    Reader(
        "poses of a machine",
        files(POSES),
        lambda folder: poses.read(folder / "labels.csv", measured=True),
    ),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
