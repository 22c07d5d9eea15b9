import hashlib

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
