"""Damaged bundles, whole ones whose content was changed and signed anew, and archives of arrays."""

import hashlib
import io
import json
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import fuzzing
import numpy as np
import pytest
from fuzzing import Case, Link, Reader
from hypothesis import strategies as st
from mutations import NASTY, changed_bytes, texts

from fastac.export.bundle_file import write_bundle_file
from fastac.models import random_bundle
from fastac.models.integer import bundle
from fastac.report import verification
from fastac.sensor.importers.cad import read_array
from fastac.store.evidence import Evidence, Table, keep
from fastac.store.files import load_arrays

NAMES = ("bundle.json", "integers.npz", "floats.npz")
JSON_FRAGMENTS = (
    *(b"[" * 100_000, b'{"a":' * 5000, b"9" * 5000, b"NaN", b"1e999", b"null", b"\xff", b"\xed\xa0\x80"),
    *(b'"\\ud800"', b'"\\u0000"', b'"sha256": "a\\nb",', b'"class": "Scene",', b'"array": "x",', b",", b"}"),
)


@cache
def sample() -> dict[str, bytes]:
    """The files of a small bundle of random integers."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "bundle"
        random_bundle.random_bundle(made, random_bundle.scene(("normals", "depth", "force_z")))
        return {name: (made / name).read_bytes() for name in NAMES}


def signed(text: bytes) -> bytes:
    """A bundle's JSON with the hash that its content has."""
    try:
        content = json.loads(text)
        content.pop("sha256", None)
        with np.load(io.BytesIO(sample()["integers.npz"])) as archive:
            arrays = {k: v.astype(np.int64) if v.dtype.kind == "i" else v for k, v in archive.items()}
        with np.load(io.BytesIO(sample()["floats.npz"])) as archive:
            arrays |= {f"float.{k}": v for k, v in archive.items()}
        return json.dumps({"sha256": bundle._digest(content, arrays), **content}).encode()
    except (ValueError, TypeError, RecursionError, AttributeError):
        return text


def header(shape: str, kind: str, data: bytes, version: int = 1) -> bytes:
    """An .npy file that declares whatever it is told."""
    text = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}".encode() + b"\n"
    return (
        b"\x93NUMPY"
        + bytes([version, 0])
        + len(text).to_bytes(2 if version == 1 else 4, "little")
        + text
        + data
    )


ARRAYS = st.builds(
    header,
    st.sampled_from(
        (
            "(3,)",
            "(2, 2)",
            "()",
            "(10**9,)",
            "(1000000000000,)",
            "(-1,)",
            "(True,)",
            "(0, 99999999999)",
            "3",
            "x",
            "(" * 500,
        )
    ),
    st.sampled_from(
        ("<i8", "|u1", "<f4", "|O", "<U99999999", "|V0", "|S0", "<M8[s]", "x", ">i4", "<c16", "a" * 2000)
    ),
    st.sampled_from((b"", b"\x01" * 24, bytes(4))),
    st.sampled_from((1, 2, 3, 9)),
)


def array_files() -> list[bytes]:
    found = []
    for array in (np.arange(6.0).reshape(2, 3), np.zeros((8, 8, 3), np.uint8)):
        file = io.BytesIO()
        np.save(file, array)
        found.append(file.getvalue())
    return found


@st.composite
def archives(draw) -> bytes:
    """A zip file with arrays that declare anything, and names that lead elsewhere."""
    file = io.BytesIO()
    with zipfile.ZipFile(
        file, "w", draw(st.sampled_from((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))
    ) as archive:
        for k in range(draw(st.integers(0, 3))):
            name = draw(st.sampled_from(("a.npy", "../a.npy", "/etc/a.npy", "a", "", "ä.npy")))
            archive.writestr(f"{k}{name}" if draw(st.booleans()) else f"{name}{k}", draw(ARRAYS))
    return file.getvalue()


NPY = st.one_of(ARRAYS, st.deferred(lambda: changed_bytes(array_files())))
NPZ = st.one_of(
    archives(), st.deferred(lambda: changed_bytes([sample()["integers.npz"], sample()["floats.npz"]]))
)
LINKS = (
    Link("/etc/hostname"),
    Link("../../bundle/bundle.json"),
    Link("bundle.json"),
    Link("."),
    Link("nowhere"),
)


def dumped(tree: dict) -> str:
    return json.dumps(tree)


def descriptions() -> st.SearchStrategy[bytes]:
    text = sample()["bundle.json"]
    values = (*NASTY, {"array": "x"}, {"tuple": []}, {"class": "Layer", "fields": {}}, {"scene": {}})
    return texts([json.loads(text)], dumped, [text], JSON_FRAGMENTS, values)


@st.composite
def folders(draw) -> Case:
    """A bundle's folder of which one file is missing, another one's, a link, or damaged."""
    files: dict = dict(sample())
    name = draw(st.sampled_from(NAMES))
    match draw(st.integers(0, 4)):
        case 0:
            del files[name]
        case 1:
            files[name] = files[draw(st.sampled_from(NAMES))]
        case 2:
            files[name] = draw(st.sampled_from(LINKS))
        case 3:
            files[f"{name}/inside"] = files.pop(name)
        case _ if name != "bundle.json":
            files[name] = draw(NPZ)
        case _:
            files[name] = draw(changed_bytes([files[name]], JSON_FRAGMENTS))
    return {f"bundle/{key}": content for key, content in files.items()}


@cache
def single_file() -> bytes:
    """A small bundle of random integers in one file."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        for name, content in sample().items():
            (made / "bundle").mkdir(exist_ok=True)
            (made / "bundle" / name).write_bytes(content)
        write_bundle_file(made / "bundle", made / "a.fastac")
        return (made / "a.fastac").read_bytes()


def contained(changes: dict[str, bytes]) -> bytes:
    """The single file with some members replaced, and a manifest that has their hashes."""
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(single_file())) as known, zipfile.ZipFile(file, "w") as archive:
        members = {name: known.read(name) for name in known.namelist()} | changes
        if "manifest.json" not in changes:
            manifest = json.loads(members["manifest.json"])
            for name, content in changes.items():
                digest = hashlib.sha256(content).hexdigest()
                manifest["files"][name] = {"bytes": len(content), "sha256": digest}
            members["manifest.json"] = json.dumps(manifest).encode()
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


def manifests() -> st.SearchStrategy[bytes]:
    with zipfile.ZipFile(io.BytesIO(single_file())) as archive:
        text = archive.read("manifest.json")
    return texts([json.loads(text)], dumped, [text], JSON_FRAGMENTS, NASTY)


SINGLE_FILES = st.one_of(
    st.deferred(
        lambda: changed_bytes([single_file(), sample()["integers.npz"]], (b"PK\x05\x06", b"PK\x01\x02"))
    ),
    archives(),
    st.deferred(manifests).map(lambda text: contained({"manifest.json": text})),
    NPZ.map(lambda content: contained({"integers.npz": content})),
    st.deferred(descriptions).map(lambda text: contained({"bundle.json": text})),
    st.binary(max_size=200).map(lambda content: contained({"README.md": content})),
)


def whole(text: bytes) -> Case:
    return {f"bundle/{name}": content for name, content in (sample() | {"bundle.json": text}).items()}


EVIDENCE = Evidence(
    "fuzz", "Bad files", "make fuzz", "All.", 1.0, [Table("A", ["b"], [[1, None]])], ["x"], "0"
)


def evidence_files() -> st.SearchStrategy[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        text = keep(EVIDENCE, Path(folder)).read_bytes()
    return texts([json.loads(text)], dumped, [text], JSON_FRAGMENTS)


def command(folder: Path) -> list:
    return ["verilog", folder, "-o", folder / fuzzing.OUTPUT]


READERS = [
    Reader(
        "bundle's description",
        st.deferred(descriptions).map(whole),
        bundle.load_bundle,
        command,
    ),
    Reader(
        "bundle's description, signed anew",
        st.deferred(descriptions).map(signed).map(whole),
        bundle.load_bundle,
        count=10_000,
    ),
    Reader("bundle's files", folders(), bundle.load_bundle, command),
    Reader(
        "bundle in one file",
        SINGLE_FILES.map(lambda content: {"a.fastac": content}),
        lambda f: bundle.load_bundle(f / "a.fastac"),
        lambda f: ["card", f / "a.fastac"],
    ),
    Reader(
        "archive of arrays", NPZ.map(lambda content: {"a.npz": content}), lambda f: load_arrays(f / "a.npz")
    ),
    Reader("height map", NPY.map(lambda content: {"a.npy": content}), lambda f: read_array(f / "a.npy")),
    Reader(
        "results of a campaign",
        st.deferred(evidence_files).map(lambda text: {"fuzz.json": text}),
        lambda f: verification.of_folders(f, f / fuzzing.OUTPUT),
        lambda f: [
            *("prove", "page", "--evidence", f, "--kept", f / fuzzing.OUTPUT),
            *("-o", f / fuzzing.OUTPUT / "page.md"),
        ],
    ),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
