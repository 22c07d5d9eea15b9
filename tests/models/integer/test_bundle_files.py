"""Single-file bundles that are whole, damaged, made on purpose to do harm, or of other versions."""

import hashlib
import json
import zipfile

import numpy as np
import pytest

from fastac.export.bundle_file import write_bundle_file
from fastac.models import random_bundle
from fastac.models.integer import bundle
from fastac.models.integer.bundle import BundleError
from fastac.models.integer.bundle_files import MOST_BYTES, NAMES


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A bundle's folder and the single file of it."""
    folder = tmp_path_factory.mktemp("single") / "random"
    random_bundle.random_bundle(folder, random_bundle.scene(("depth", "force_z")))
    file = folder.with_suffix(".fastac")
    write_bundle_file(folder, file)
    return folder, file


def members_of(file) -> dict[str, bytes]:
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write(path, members, compression=zipfile.ZIP_STORED):
    """An archive of pairs of names and contents, whose manifest is as it is given."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


def resigned(members: dict[str, bytes], **changes) -> dict[str, bytes]:
    """The members with a manifest that has their hashes, and other changes."""
    manifest = json.loads(members["manifest.json"])
    manifest["files"] = {
        name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in members.items()
        if name != "manifest.json"
    }
    return members | {"manifest.json": json.dumps(manifest | changes).encode()}


def refused(path, match: str) -> None:
    with pytest.raises(BundleError, match=match) as caught:
        bundle.load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_the_file_loads_as_the_folder_does(whole):
    folder, file = whole
    known, found = bundle.load(folder), bundle.load_bundle(file)
    assert found.digest == known.digest
    assert found.scene == known.scene
    np.testing.assert_array_equal(found.pipeline.force.kernel, known.pipeline.force.kernel)
    assert bundle.load_for(file, known.scene).digest == known.digest


def test_nothing_is_written_beside_it(whole):
    _, file = whole
    before = sorted(file.parent.iterdir())
    bundle.load(file)
    assert sorted(file.parent.iterdir()) == before


def test_compressed_members_are_read_too(whole, tmp_path):
    folder, file = whole
    packed = write(tmp_path / "a.fastac", members_of(file).items(), zipfile.ZIP_DEFLATED)
    assert packed.stat().st_size < file.stat().st_size
    assert bundle.load(packed).digest == bundle.load(folder).digest


@pytest.mark.parametrize("name", NAMES)
def test_a_changed_member_is_named(whole, tmp_path, name):
    members = members_of(whole[1])
    members[name] = members[name][:-1] + bytes([members[name][-1] ^ 1])
    refused(
        write(tmp_path / "a.fastac", members.items()), f"a.fastac: {name}: sha256 is .* changed or damaged"
    )


def test_a_changed_member_that_is_signed_anew_is_refused_by_the_bundles_own_hash(whole, tmp_path):
    members = members_of(whole[1])
    members["bundle.json"] = members["bundle.json"].replace(b"random_bundle", b"other_bundles", 1)
    refused(write(tmp_path / "a.fastac", resigned(members).items()), "sha256 = .*changed or damaged")


def test_the_manifest_of_another_bundle(whole, tmp_path):
    members = resigned(members_of(whole[1]), bundle_sha256="0" * 64)
    refused(write(tmp_path / "a.fastac", members.items()), "the manifest is another bundle's")


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_member_that_is_there_twice(whole, tmp_path):
    members = [*members_of(whole[1]).items(), ("bundle.json", b"{}")]
    refused(write(tmp_path / "a.fastac", members), "'bundle.json': is there twice")


@pytest.mark.parametrize("name", ["../../evil.py", "/etc/passwd", "more.json"])
def test_other_members_are_refused(whole, tmp_path, name):
    members = resigned(members_of(whole[1]) | {name: b"x"})
    refused(write(tmp_path / "a.fastac", members.items()), "unknown member")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.fastac"]


@pytest.mark.parametrize("name", ["bundle.json", "floats.npz", "manifest.json", "card.json"])
def test_a_missing_member(whole, tmp_path, name):
    members = members_of(whole[1])
    del members[name]
    refused(write(tmp_path / "a.fastac", members.items()), f"{name}'?: missing")


@pytest.mark.parametrize(
    ("version", "hint"),
    [
        (2, "; it was written by a newer fastac"),
        (0, "; it was written by an older fastac"),
        ("1", ""),
        (None, ""),
    ],
)
def test_another_version_of_the_file(whole, tmp_path, version, hint):
    members = resigned(members_of(whole[1]), format_version=version)
    path = write(tmp_path / "a.fastac", members.items())
    refused(path, f"manifest.json: format_version = {version!r}: expected 1{hint}")


def test_a_newer_file_may_have_other_members(whole, tmp_path):
    members = resigned(members_of(whole[1]) | {"more.bin": b"x"}, format_version=2)
    refused(write(tmp_path / "a.fastac", members.items()), "written by a newer fastac")


@pytest.mark.parametrize(("version", "age"), [(5, "a newer fastac"), (2, "an older fastac")])
def test_another_version_of_the_bundle(whole, tmp_path, version, age):
    members = members_of(whole[1])
    content = json.loads(members["bundle.json"]) | {"format_version": version}
    members["bundle.json"] = json.dumps(content).encode()
    path = write(tmp_path / "a.fastac", resigned(members).items())
    refused(path, f"bundle.json: format_version = {version}: expected 3 or 4; it was written by {age}")


def declare(path, name: str, size: int) -> None:
    """Overwrite the size that the archive's directory declares for a member."""
    content = bytearray(path.read_bytes())
    at = content.rindex(name.encode()) - 46
    assert content[at : at + 4] == b"PK\x01\x02"
    content[at + 24 : at + 28] = size.to_bytes(4, "little")
    path.write_bytes(content)


def test_members_that_would_fill_the_memory(whole, tmp_path):
    path = write(tmp_path / "a.fastac", members_of(whole[1]).items())
    declare(path, "integers.npz", MOST_BYTES)
    refused(path, f"bytes are declared: expected at most {MOST_BYTES}")


def test_a_member_that_grows_more_than_compression_allows(whole, tmp_path):
    path = write(tmp_path / "a.fastac", members_of(whole[1]).items())
    declare(path, "floats.npz", MOST_BYTES // 2)
    refused(path, f"floats.npz: {MOST_BYTES // 2} bytes are declared, not")
    members = members_of(whole[1])
    manifest = json.loads(members["manifest.json"])
    manifest["files"]["floats.npz"]["bytes"] = MOST_BYTES // 2
    path = write(tmp_path / "b.fastac", (members | {"manifest.json": json.dumps(manifest).encode()}).items())
    declare(path, "floats.npz", MOST_BYTES // 2)
    refused(path, "'floats.npz': .* bytes of .* are declared")


def test_arrays_that_would_fill_the_memory(whole, tmp_path, monkeypatch):
    """Arrays compressed inside integers.npz, each as it should be, but too many bytes together."""
    monkeypatch.setattr("fastac.models.integer.bundle_files.MOST_BYTES", 60_000)
    huge = tmp_path / "huge.npz"
    np.savez_compressed(huge, a=np.zeros(100_000, np.int8))
    members = resigned(members_of(whole[1]) | {"integers.npz": huge.read_bytes()})
    path = write(tmp_path / "a.fastac", members.items())
    refused(path, "integers.npz: damaged or no .npz file .* bytes are declared, more than 60000")


def test_pickles_are_not_opened(whole, tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "opened"), "w"))

    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, x=np.array([Bomb()], dtype=object))
    members = resigned(members_of(whole[1]) | {"floats.npz": pickled.read_bytes()})
    refused(write(tmp_path / "a.fastac", members.items()), "floats.npz: damaged or no .npz file")
    assert not (tmp_path / "opened").exists()


@pytest.mark.parametrize("content", [b"", b"PK", b"x" * 100, b"PK\x05\x06" + bytes(18)])
def test_files_that_are_no_archives(tmp_path, content):
    path = tmp_path / "a.fastac"
    path.write_bytes(content)
    refused(path, "damaged or no .fastac file|manifest.json: missing")


def test_no_such_file(tmp_path):
    refused(tmp_path / "a.fastac", r"a\.fastac: no such file$")


def test_other_files_are_no_bundles(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("x = 1")
    refused(path, "not a bundle: expected a folder or a .fastac file")
