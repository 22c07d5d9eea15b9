import io
import os
import pickle
import struct
import subprocess

import numpy as np
import pytest

from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.plain_pickle import load, load_npy

ARRAYS = {
    "bytes": np.arange(24, dtype=np.uint8).reshape(2, 3, 4),
    "floats": np.linspace(-1, 1, 6).astype(np.float32).reshape(3, 2),
    "fortran": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
    "big-endian": np.arange(5, dtype=">i4"),
    "booleans": np.array([True, False]),
    "empty": np.zeros((0, 3)),
    "none": np.array(2.5),
}
PLAIN = {
    "text": "ä",
    "number": -7,
    "large": 2**70,
    "real": 0.1,
    "truth": [True, False, None],
    3: (1, (2, "x")),
    "image": b"\xff\xd8\xff",
    "buffer": b"",
    "nested": {"list": [[], [1]]},
    2.5: (),
}


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.pkl"


def loaded(file, content: bytes):
    file.write_bytes(content)
    return load(file)


def refused(file, content: bytes) -> str:
    with pytest.raises(ImportFailure) as error:
        loaded(file, content)
    assert str(error.value).startswith(f"{file}: ")
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_and_plain_values_come_back(file, protocol):
    shared = np.arange(3)
    given = {
        "plain": PLAIN,
        "arrays": ARRAYS,
        "scalars": [np.float64(0.1), np.int64(-3), np.bool_(True), np.uint8(255)],
        "twice": [shared, shared],
    }
    got = loaded(file, pickle.dumps(given, protocol))
    assert got["plain"] == PLAIN
    assert got["scalars"] == [0.1, -3, True, 255]
    assert {type(value) for value in got["scalars"]} == {float, int, bool}
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(got["arrays"][name], array)
        assert got["arrays"][name].dtype == array.dtype.newbyteorder("=")
    assert got["twice"][0] is got["twice"][1]


def test_names_of_older_numpy_are_known(file):
    content = pickle.dumps(ARRAYS["floats"], 2).replace(b"numpy._core", b"numpy.core")
    np.testing.assert_array_equal(loaded(file, content), ARRAYS["floats"])


def test_a_dict_that_numpy_saved(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, {"image": ARRAYS["bytes"], "force": np.float64(1.5)})
    got = load_npy(path)
    assert got["force"] == 1.5
    np.testing.assert_array_equal(got["image"], ARRAYS["bytes"])
    np.save(path, ARRAYS["floats"])
    np.testing.assert_array_equal(load_npy(path), ARRAYS["floats"])
    np.save(path, np.array([{}, {}]))
    with pytest.raises(ImportFailure, match=r"a\.npy: refused: it holds an array of objects of shape \(2,\)"):
        load_npy(path)
    path.write_bytes(b"\x93NUMPY\x09\x00")
    with pytest.raises(ImportFailure, match=r"a\.npy: damaged or no \.npy file"):
        load_npy(path)


class Calls:
    def __init__(self, function, *given):
        self.reduced = function, given

    def __reduce__(self):
        return self.reduced


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_nothing_is_called(file, tmp_path, protocol):
    touched = tmp_path / "touched"
    for name, bad in (
        (r"posix\.system", Calls(os.system, f"touch {touched}")),
        (r"(subprocess|commands)\.Popen", Calls(subprocess.Popen, f"touch {touched}", -1)),
        (r"builtins\.eval|__builtin__\.eval", Calls(eval, "1")),
        (r"builtins\.getattr|__builtin__\.getattr", Calls(getattr, Calls(os.system, "true"), "x")),
        (r"numpy\.load", Calls(np.load, "a.npy")),
    ):
        for held in (bad, {"x": [bad]}, (np.arange(3), bad), Calls(np.dtype, bad)):
            message = refused(file, pickle.dumps(held, protocol))
            assert "refused: it holds the name" in message
            if held is bad:
                import re

                assert re.search(name, message), message
    assert not touched.exists()


def test_other_objects_are_refused(file):
    assert "array of objects of shape (2,)" in refused(file, pickle.dumps(np.array([{}, []], object)))
    assert "EMPTY_SET" in refused(file, pickle.dumps({1, 2}))
    assert "NEWOBJ" in refused(file, b"\x80\x04\x8c\x05numpy\x8c\x07ndarray\x93)\x81.")
    assert "BINPERSID" in refused(file, b"\x80\x04\x8c\x01aQ.")
    assert "only numbers are read" in refused(file, pickle.dumps(np.array(["text"])))
    assert "only numbers are read" in refused(file, pickle.dumps(np.zeros(2, complex)))
    assert "only numbers are read" in refused(file, pickle.dumps(np.datetime64("2020-01-01", "D")))
    records = np.zeros(2, [("a", "i4"), ("b", "f8")])
    assert "only numbers are read" in refused(file, pickle.dumps(records))
    assert "a key that is no text" in refused(file, pickle.dumps({(1, 2): 3}))


def test_shapes_larger_than_the_bytes(file):
    good = pickle.dumps(np.zeros((3, 5), np.uint8), 4)
    assert good.count(b"K\x03K\x05\x86") == 1
    huge = good.replace(b"K\x03K\x05\x86", b"J" + struct.pack("<i", 2**31 - 1) + b"K\x05\x86")
    assert "bytes, of which 15 are there" in refused(file, huge)
    assert "whose shape is none" in refused(
        file, good.replace(b"K\x03K\x05\x86", b"J\xff\xff\xff\xffK\x05\x86")
    )


def test_declared_lengths_longer_than_the_file(file):
    assert "damaged or no pickle" in refused(file, b"\x80\x04\x8e" + struct.pack("<Q", 2**40) + b"abc.")
    assert "damaged or no pickle" in refused(file, b"\x80\x05\x96" + struct.pack("<Q", 2**63) + b"abc.")
    assert "that is not there" in refused(file, b"\x80\x04r" + struct.pack("<I", 2**32 - 1) + b".")


def test_cut_files(file):
    content = pickle.dumps({"a": [1, 2.5, "x", b"y"], "b": ARRAYS["floats"]}, 4)
    for length in range(len(content)):
        refused(file, content[:length])
    with pytest.raises(ImportFailure, match="no such file"):
        load(file.with_name("b.pkl"))


@pytest.mark.parametrize(
    "content",
    [
        *(b".", b"(.", b"a.", b"]a.", b"}s.", b"}K\x01K\x02K\x03s.", b"]K\x01.", b"t.", b"u.", b"e."),
        *(b"\x85.", b"R.", b"b.", b"\x94.", b"h\x00.", b"(K\x01d.", b"K\x01K\x02R.", b"(]e.", b"]K\x01b."),
        b"cnumpy\nndarray\n.",
        b"cnumpy\nndarray\n)R.",
        b"]cnumpy\nndarray\na.",
        b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00K\x00tR.",
        b"]cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00K\x00tRa.",
        b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00K\x00tRq\x01h\x01.",
        b"cnumpy\ndtype\n(V\xff\nI00\nI01\ntR(I3\nV<\ntb.",
    ],
)
def test_what_makes_no_sense(file, content):
    refused(file, content)


def test_values_of_our_own_are_not_left_over(file):
    out = io.BytesIO()
    pickle.dump([1], out)
    out.write(b"rest")
    assert loaded(file, out.getvalue()) == [1]
