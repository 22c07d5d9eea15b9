"""Damaged datasets: HDF5 files with other trees, and with other bytes."""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

import fuzzing
import h5py
import numpy as np
import pytest
from fuzzing import Link, Reader
from hypothesis import strategies as st
from mutations import changed_bytes

from fastac.models import random_bundle
from fastac.sensor import dataset

COUNT, SIZE = 3, 8
VALUES = (
    *(
        0,
        -1,
        2,
        2**40,
        1.5,
        np.nan,
        np.inf,
        "",
        "B,G,R,NIR",
        "B,G",
        "x" * 3000,
        b"\xff\xfe",
        "é",
        np.uint8(1),
    ),
    *(np.zeros(3), np.zeros((1000, 1000)), h5py.Empty("f"), np.array([b"a"]), np.float32(0.1), np.int64(1)),
)
KEYS = (
    *("frames", "background", "split", "normals", "depth_mm", "valid", "force_n", "group", "rest_depth_mm"),
    *("indenter", "indenter/x_mm", "raw10", "markers_px", "tangential_mm"),
)
ATTRIBUTES = ("format_version", "pitch_mm", "channels", "source", "force_axes", "left_out")


def write_sample(path: Path, raw10: bool = False) -> None:
    rng = np.random.default_rng(1)
    image = (4 * SIZE, 4 * SIZE) if raw10 else (SIZE, SIZE, 3)
    frames = rng.integers(0, 256, (COUNT, *image)).astype(np.uint16 if raw10 else np.uint8)
    normals = np.zeros((COUNT, SIZE, SIZE, 3), np.float32)
    normals[..., 2] = 1
    dataset.write(
        path,
        pitch_mm=0.1,
        channels=("B", "G", "R"),
        source="simulated",
        background=frames[0],
        split=np.array(["train", "validation", "test"]),
        normals=normals,
        depth_mm=np.ones((COUNT, SIZE, SIZE), np.float32),
        force_n=np.ones((COUNT, 2), np.float32),
        force_axes=("x", "z"),
        group=np.array(["a", "b", "c"]),
        indenter={"x_mm": np.ones(COUNT)},
        **{"raw10" if raw10 else "frames": frames},
    )


@cache
def samples() -> list[bytes]:
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for raw10 in (False, True):
            path = Path(folder) / "sample.h5"
            write_sample(path, raw10)
            found.append(path.read_bytes())
    return found


def _replaced(file: h5py.File, key: str, new) -> None:
    """Put something else at `key`: an array, a link, or nothing."""
    known = file.get(key)
    small = isinstance(known, h5py.Dataset) and known.size < 10**6
    old = np.asarray(known[()]) if small else np.zeros(3, np.float32)
    if key in file:
        del file[key]
    kind, value = new
    match kind:
        case "dtype":
            file[key] = np.zeros(old.shape, value)
        case "shape":
            file.create_dataset(key, shape=value, dtype=old.dtype)
        case "packed":
            file.create_dataset(key, shape=value, dtype=old.dtype, chunks=True, compression="gzip")
        case "tiny chunks":
            file.create_dataset(key, shape=value, dtype=old.dtype, chunks=(1,) * len(value))
        case "value":
            with np.errstate(invalid="ignore"):
                file[key] = np.full(old.shape, value).astype(old.dtype) if old.dtype.kind in "fiub" else old
        case "texts":
            file.create_dataset(key, data=value, dtype=h5py.string_dtype("utf-8"))
        case "fixed texts":
            file[key] = np.array(value, "S10")
        case "group":
            file.create_group(key)
        case "soft":
            file[key] = h5py.SoftLink(value)
        case "external":
            file[key] = h5py.ExternalLink(value, "/frames")
        case "stored outside":
            size = int(np.prod(old.shape)) * old.dtype.itemsize
            where = [(value.encode(), 0, size)]
            file.create_dataset(key, shape=old.shape, dtype=old.dtype, external=where)
        case "virtual":
            layout = h5py.VirtualLayout(shape=old.shape or (3,), dtype=old.dtype)
            layout[...] = h5py.VirtualSource(value, "frames", shape=old.shape or (3,))
            file.create_virtual_dataset(key, layout)
        case "reference":
            file.create_dataset(key, data=[file.ref] * 3, dtype=h5py.ref_dtype)
        case "variable":
            file.create_dataset(key, (3,), dtype=h5py.vlen_dtype(np.float32))
        case "compound":
            file[key] = np.zeros(3, [("a", "f4"), ("b", "S3")])


SHAPES = (
    (0,),
    (1,),
    (),
    (3, 8, 8, 3),
    (3, 8, 8),
    (3, 2),
    (2**20, 2**20),
    (10**6, 64, 64, 3),
    (3, 0, 0, 3),
    (2**40,),
)
OUTSIDE = ("../other.h5", "/etc/hostname", "other.h5", "")
NEW = st.one_of(
    st.tuples(
        st.just("dtype"), st.sampled_from(("f2", "f4", ">f4", "f8", "u1", "i8", "?", "c8", "S3", "u2", ">u2"))
    ),
    st.tuples(st.sampled_from(("shape", "packed", "tiny chunks")), st.sampled_from(SHAPES)),
    st.tuples(st.just("value"), st.sampled_from((0, 1, -1.0, 1e30, 255, 2))),
    st.tuples(
        st.just("texts"), st.sampled_from((["train"] * 3, ["", "", ""], ["x"], [b"\xff"] * 3, ["a\nb"] * 3))
    ),
    st.tuples(st.just("fixed texts"), st.sampled_from((["train"] * 3, ["x"] * 3))),
    st.tuples(st.sampled_from(("group", "reference", "variable", "compound")), st.none()),
    st.tuples(st.just("soft"), st.sampled_from(("/frames", "/nowhere", "/", "/split"))),
    st.tuples(st.sampled_from(("external", "stored outside", "virtual")), st.sampled_from(OUTSIDE)),
)
EDITS = st.one_of(
    st.tuples(st.just("array"), st.sampled_from((*KEYS, "unknown", "indenter/new")), NEW),
    st.tuples(st.just("attribute"), st.sampled_from((*ATTRIBUTES, "other")), st.sampled_from(VALUES)),
    st.tuples(st.just("delete"), st.sampled_from(KEYS), st.none()),
    st.tuples(st.just("no attribute"), st.sampled_from(ATTRIBUTES), st.none()),
)


def edited(raw10: bool, edits: list) -> "fuzzing.Content":
    """A function that writes a sample with these edits; what h5py itself refuses is left as it is."""

    def write(path: Path) -> None:
        path.write_bytes(samples()[raw10])
        with h5py.File(path, "r+") as file:
            for kind, key, new in edits:
                try:
                    match kind:
                        case "array":
                            _replaced(file, key, new)
                        case "attribute":
                            file.attrs[key] = new
                        case "delete":
                            del file[key]
                        case _:
                            del file.attrs[key]
                except (KeyError, ValueError, TypeError, OSError, RuntimeError):
                    continue

    return write


TREES = st.builds(edited, st.booleans(), st.lists(EDITS, min_size=1, max_size=2))
BYTES = st.deferred(lambda: changed_bytes(samples()))
LINKS = st.sampled_from((Link("../other.h5"), Link("/etc/hostname"), Link("data.h5"), Link("nowhere")))


def read(folder: Path) -> None:
    """As every command reads a dataset."""
    dataset.read(folder / "data.h5")


@cache
def trained() -> Path:
    """A bundle for `fastac predict`, which reads a dataset first of all."""
    folder = Path(tempfile.mkdtemp(prefix="fastac-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    random_bundle.random_bundle(folder / "bundle", random_bundle.scene(("normals",)))
    return folder


def command(folder: Path) -> list:
    return ["predict", trained(), folder / "data.h5", "-o", folder / fuzzing.OUTPUT / "a.h5", "--no-progress"]


READERS = [
    Reader(
        "dataset, its tree",
        TREES.map(lambda content: {"data.h5": content, "other.h5": samples()[0]}),
        read,
        command,
        quick=60,
    ),
    Reader("dataset, its bytes", BYTES.map(lambda content: {"data.h5": content}), read, command, quick=100),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
