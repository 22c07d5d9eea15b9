"""Damaged recordings in the layouts of other projects: their folders, pickles and ROS 2 recordings."""

import pickle
import tempfile
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import fuzzing
import numpy as np
import pytest
from fuzzing import Case, Content, Link, Reader
from hypothesis import strategies as st
from miniatures import (
    estimate_modulus_folder,
    feats_folder,
    fots_folder,
    gs_sdk_folder,
    tacbench_folder,
    taxim_pack,
)
from mutations import changed_bytes

from fastac.sensor.importers import (
    estimate_modulus,
    feats,
    fots,
    gs_sdk,
    plain_pickle,
    rosbag2,
    tacbench,
    taxim,
)

SIZE = {"height_px": 16, "width_px": 16, "progress": False}
NAMED = ("rest.npy", "plum.mcap")
"""What a user names, who may name a link."""
LINKS = (Link("/etc/hostname"), Link("../whole.png"), Link("nowhere"))
VALUES = {"a": [1, -2.5, "x", b"y", None, True, (2**70,)], "b": np.arange(6.0).reshape(2, 3), "c": np.int8(3)}
PICKLES = [pickle.dumps(VALUES, protocol) for protocol in range(6)]
FRAGMENTS = (
    *(
        b"cos\nsystem\n(S'true'\ntR.",
        b"\x8c\x05posix\x8c\x06system\x93",
        b"R",
        b"b",
        b"\x81",
        b"\x85",
        b"0",
        b"2",
    ),
    *(
        b"r\xff\xff\xff\xff",
        b"J\xff\xff\xff\x7f",
        b"\x8e\xff\xff\xff\xff\xff\xff\xff\x7f",
        b"(",
        b"]",
        b"}",
        b"e",
    ),
    *(b"O8", b"V8", b"M8", b"f8", b"I" + b"9" * 5000 + b"\n", b"(" * 5000, b"\x85" * 5000, b"Q", b"\x82\x01"),
)


@cache
def held(make: Callable[[Path], object]) -> dict[str, bytes]:
    """The files of a miniature by their names."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "recording"
        make(folder)
        files = [path for path in folder.rglob("*") if path.is_file()]
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@st.composite
def folders(draw, make: Callable[[Path], object]) -> Case:
    """A miniature of which a file is damaged, another one's, a link, or missing."""
    files: dict[str, Content] = dict(held(make))
    names = sorted(files)
    name = draw(st.sampled_from(names))
    match draw(st.integers(0, 5)):
        case 0 | 1 | 2:
            files[name] = draw(changed_bytes([held(make)[name]], FRAGMENTS))
        case 3:
            files[name] = files[draw(st.sampled_from(names))]
        case 4 if name not in NAMED:
            files[name] = draw(st.sampled_from(LINKS))
        case _:
            del files[name]
    return {f"recording/{key}": value for key, value in files.items()} | {"whole.png": b""}


def out(folder: Path) -> Path:
    path = folder / fuzzing.OUTPUT / "a.h5"
    path.parent.mkdir()
    return path


def import_gs_sdk(folder: Path) -> None:
    gs_sdk.import_folder(folder / "recording", px_per_mm=10.0, output=out(folder), **SIZE)


def gs_sdk_command(folder: Path) -> list:
    given = ["--px-per-mm", 10, "--no-progress", "--height-px", 16, "--width-px", 16]
    return ["import", "gs-sdk", folder / "recording", *given, "-o", folder / fuzzing.OUTPUT / "a.h5"]


def import_fots(folder: Path) -> None:
    fots.import_folder(folder / "recording", ball_mm=4.0, px_per_mm=10.0, output=out(folder), **SIZE)


def import_taxim(folder: Path) -> None:
    pack = folder / "recording" / "dataPack.npz"
    taxim.import_pack(pack, ball_mm=4.0, px_per_mm=10.0, output=out(folder), **SIZE)


def import_feats(folder: Path) -> None:
    where = folder / "recording"
    feats.import_folder(where, where / "rest.npy", pitch_mm=0.2, output=out(folder), **SIZE)


def import_grasps(folder: Path) -> None:
    where = folder / "recording"
    estimate_modulus.import_folder(where, background_frames=2, pitch_mm=0.2, output=out(folder), **SIZE)


def import_tacbench(folder: Path) -> None:
    tacbench.import_folder(folder / "recording", pitch_mm=0.2, output=out(folder), **SIZE)


def tacbench_command(folder: Path) -> list:
    given = ["--pitch-mm", 0.2, "--no-progress", "--height-px", 16, "--width-px", 16]
    return ["import", "tacbench", folder / "recording", *given, "-o", folder / fuzzing.OUTPUT / "a.h5"]


def bags(folder: Path) -> None:
    from miniature_bags import messages, write_bag, write_mcap

    write_bag(folder, messages())
    write_bag(folder / "sqlite", messages(), "sqlite3")
    write_mcap(folder / "plum.mcap", messages("png"))


def import_bags(folder: Path) -> None:
    where = folder / "recording"
    given = {"pitch_mm": 0.2, "background_frames": 2, "output": out(folder), **SIZE}
    rosbag2.import_recordings([where, where / "sqlite", where / "plum.mcap"], **given)


READERS = [
    Reader(
        "pickle",
        changed_bytes(PICKLES, FRAGMENTS).map(lambda c: {"a.pkl": c}),
        lambda f: plain_pickle.load(f / "a.pkl"),
    ),
    Reader(
        "calibration folder of gs_sdk", folders(gs_sdk_folder), import_gs_sdk, gs_sdk_command, count=5_000
    ),
    Reader("ball presses of FOTS", folders(fots_folder), import_fots, count=5_000, quick=20),
    Reader("data pack of Taxim", folders(taxim_pack), import_taxim, count=5_000, quick=20),
    Reader("frames of FEATS", folders(feats_folder), import_feats, count=5_000, quick=20),
    Reader(
        "grasps of EstimateModulus",
        folders(estimate_modulus_folder),
        import_grasps,
        count=5_000,
        quick=20,
    ),
    Reader(
        "batches of TacBench",
        folders(tacbench_folder),
        import_tacbench,
        tacbench_command,
        count=5_000,
        quick=20,
    ),
]
if find_spec("rosbags") and find_spec("mcap"):
    READERS.append(Reader("ROS 2 recordings", folders(bags), import_bags, count=2_000, quick=20))


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
