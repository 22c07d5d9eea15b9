import hashlib
import zipfile

import numpy as np
import pytest

from fastac.store import files


def test_digests(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    assert files.digest_file(tmp_path / "a") == hashlib.sha256(b"abc").hexdigest()
    assert files.content_hash({"a": 1, "b": 2}) == files.content_hash({"b": 2, "a": 1})
    assert files.content_hash(1, 2) != files.content_hash([1, 2])


def test_a_failed_write_leaves_what_was_there(tmp_path):
    path = tmp_path / "deep" / "a.json"
    files.write_json(path, {"a": [1]})
    assert files.read_json(path) == {"a": [1]}
    assert path.stat().st_mode & 0o777 == 0o644

    def write_half() -> None:
        with files.write_atomically(path) as temporary:
            temporary.write_text("half")
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        write_half()
    assert files.read_json(path) == {"a": [1]}
    assert list(path.parent.iterdir()) == [path]


def test_arrays(tmp_path):
    path = tmp_path / "a.npz"
    files.save_arrays(path, {"x": np.arange(3), "y.z": np.ones((2, 2))})
    first = path.read_bytes()
    files.save_arrays(path, {"x": np.arange(3), "y.z": np.ones((2, 2))})
    assert path.read_bytes() == first
    loaded = files.load_arrays(path)
    assert list(loaded) == ["x", "y.z"]
    assert loaded["x"].tolist() == [0, 1, 2]


@pytest.mark.parametrize("damage", [b"", b"no archive", None, "flip"])
def test_a_damaged_file_is_named(tmp_path, damage):
    path = tmp_path / "a.npz"
    files.save_arrays(path, {"x": np.arange(1000)})
    whole = path.read_bytes()
    flipped = whole[:60] + bytes([whole[60] ^ 255]) + whole[61:]
    path.write_bytes(whole[:-100] if damage is None else flipped if damage == "flip" else damage)
    with pytest.raises(files.DamagedFileError, match=r"a\.npz: damaged") as caught:
        files.load_arrays(path)
    assert "\n" not in str(caught.value)
    path.with_suffix(".json").write_text("{")
    with pytest.raises(files.DamagedFileError, match=r"a\.json: damaged"):
        files.read_json(path.with_suffix(".json"))


def test_a_missing_file_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError):
        files.load_arrays(tmp_path / "none.npz")


def test_a_folder_is_replaced_whole_or_not_at_all(tmp_path):
    folder = tmp_path / "deep" / "verilog"
    for text in ("old", "new"):
        with files.write_folder_atomically(folder) as temporary:
            (temporary / f"{text}.v").write_text(text)
    assert folder.stat().st_mode & 0o777 == 0o755

    def write_half() -> None:
        with files.write_folder_atomically(folder) as temporary:
            (temporary / "half.v").write_text("half")
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        write_half()
    assert [path.name for path in folder.parent.iterdir()] == ["verilog"]
    assert [path.name for path in folder.iterdir()] == ["new.v"]


def header(shape: str, kind: str = "<f8") -> bytes:
    """The beginning of an .npy file that declares this shape."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            header("(1000000000000,)") + bytes(8),
            r"\(1000000000000,\) of float64: 8000000000000 bytes are declared",
        ),
        (header("(1,)") + bytes(16), "8 bytes are declared, 16 follow"),
        (header("(-1, -1)") + bytes(8), "8 bytes are declared"),
        (header("(9,)", "|V0"), "0 bytes are declared"),
        (header("(1,)", "|O") + bytes(8), "Object arrays cannot be loaded"),
        (header("(" * 500), "EOF"),
        (b"", "EOF"),
    ],
)
def test_arrays_that_declare_another_size(tmp_path, content, message):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", content)
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(files.DamagedFileError, match=rf"a\.npz: damaged.*{message}"):
        files.load_arrays(tmp_path / "a.npz")
    with pytest.raises(files.DamagedFileError, match=r"a\.npy: not a readable array") as caught:
        files.load_array(tmp_path / "a.npy")
    assert "\n" not in str(caught.value)


def test_an_archive_that_declares_more_than_it_holds(tmp_path):
    path = tmp_path / "a.npz"
    files.save_arrays(path, {"x": np.zeros(100_000)})
    assert files.load_arrays(path)["x"].shape == (100_000,)
    content = bytearray(path.read_bytes())
    at = content.index(b"PK\x01\x02") + 24
    content[at : at + 4] = (2**31).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(files.DamagedFileError, match=r"'x\.npy': 2147483648 bytes of \d+"):
        files.load_arrays(path)


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "\ufffe{"])
def test_json_that_cannot_be_read(tmp_path, text):
    (tmp_path / "a.json").write_text(text, encoding="utf-8")
    with pytest.raises(files.DamagedFileError, match=r"a\.json: damaged or no JSON"):
        files.read_json(tmp_path / "a.json")


def test_names_that_lead_out_of_a_folder(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "secret").write_text("")
    (folder / "out").symlink_to("../secret")
    (folder / "round").symlink_to("round")
    (folder / "in").symlink_to("file")
    for name in ("file", "in", "deep/file", "deep/../file"):
        assert files.inside(folder, name) == folder / name
    for name in ("out", "round", "../secret", "/etc/hostname", "a\0b"):
        with pytest.raises(files.DamagedFileError, match="not a file inside this folder"):
            files.inside(folder, name)
