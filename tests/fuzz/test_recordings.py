"""Damaged recordings: photographs, videos, machine protocols with their frames, CAD surfaces."""

import io
import struct
import tempfile
from functools import cache
from pathlib import Path

import av
import fuzzing
import numpy as np
import pytest
from fuzzing import Case, Content, Link, Reader
from hypothesis import strategies as st
from mutations import changed_bytes
from PIL import Image

from fastac.models import random_bundle
from fastac.sensor.importers import ball_press, cad, cnc, force_recording, poses
from fastac.sensor.importers.footage import footage, photograph
from fastac.sensor.importers.poses import Pose

SIZE = 20
RNG = np.random.default_rng(1)
PICTURE = RNG.integers(0, 256, (SIZE, SIZE, 3)).astype(np.uint8)
LABELS = """\
image,center_x_px,center_y_px,radius_px,split
a.png,9,9,5,train
b.png,10,10,4,test
"""
FORCES = "frame,force_z_n,group\n" + "".join(f"{k},{0 if k < 2 else 1.5},{'ab'[k // 3]}\n" for k in range(6))
PLAYLIST = b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n../whole.mp4\n#EXT-X-ENDLIST\n"
CONCAT = b"ffconcat version 1.0\nfile ../whole.mp4\n"
SCENE = random_bundle.scene(("normals",))


def picture(kind: str, mode: str = "RGB", size: int = SIZE) -> bytes:
    file = io.BytesIO()
    Image.fromarray(PICTURE[:size, :size]).convert(mode).save(file, kind)
    return file.getvalue()


def declaring(width: int, height: int, kind: str) -> bytes:
    """A small picture that says it is larger."""
    content = bytearray(picture(kind))
    if kind == "PNG":
        content[16:24] = struct.pack(">II", width, height)
        import zlib

        content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    else:
        content[18:26] = struct.pack("<ii", width, height)
    return bytes(content)


PICTURES = [picture("PNG"), picture("JPEG"), picture("BMP"), picture("TIFF")]
OTHERS = [
    *(
        picture("PNG", "L"),
        picture("PNG", "P"),
        picture("GIF", "P"),
        picture("EPS"),
        picture("WEBP"),
        b"",
        b"x",
    ),
    *(declaring(2**31 - 1, 2**31 - 1, "PNG"), declaring(40_000, 40_000, "PNG"), declaring(9000, 9000, "PNG")),
    *(declaring(30_000, 30_000, "BMP"), picture("PNG", size=8)),
]
PHOTOGRAPHS = st.one_of(changed_bytes(PICTURES), changed_bytes(PICTURES[:1]), st.sampled_from(OTHERS))
LINKS = (Link("/etc/hostname"), Link("../whole.png"), Link("a.png"), Link("b.png"), Link("nowhere"))


@cache
def videos() -> list[bytes]:
    """Six frames, as MP4 and as AVI."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for name, codec in (("a.mp4", "mpeg4"), ("a.avi", "mjpeg"), ("a.mkv", "mpeg4")):
            path = Path(folder) / name
            with av.open(str(path), "w") as container:
                stream = container.add_stream(codec, rate=10)
                stream.width, stream.height = 32, 32
                stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
                for k in range(6):
                    image = np.full((32, 32, 3), 20 * k, np.uint8)
                    for packet in stream.encode(av.VideoFrame.from_ndarray(image, "rgb24")):
                        container.mux(packet)
                for packet in stream.encode():
                    container.mux(packet)
            found.append(path.read_bytes())
    return found


def frames_of(folder: Path) -> None:
    for _, _ in zip(range(100), footage(folder / "press.mp4"), strict=False):
        pass


def outside(case: dict) -> Case:
    """The case with whole files beside its folder, which it might name."""
    return {"whole.png": PICTURES[0], "whole.mp4": videos()[0]} | case


@st.composite
def ball_presses(draw) -> Case:
    files: dict[str, Content] = {f"{name}.png": PICTURES[0] for name in ("a", "b", "background")}
    name = draw(st.sampled_from(tuple(files)))
    labels = LABELS.encode()
    match draw(st.integers(0, 3)):
        case 0:
            files[name] = draw(PHOTOGRAPHS)
        case 1:
            files[draw(st.sampled_from(("a.png", "b.png")))] = draw(st.sampled_from(LINKS))
        case 2:
            del files[name]
        case _:
            new = draw(
                st.sampled_from(("../whole.png", "/etc/hostname", ".", "", "..", "a.png/../b.png", "\x00"))
            )
            labels = labels.replace(b"b.png", new.encode())
    content = {f"press/{key}": value for key, value in files.items()}
    return outside(content | {"labels.csv": labels})


def import_presses(folder: Path) -> None:
    where, out = folder / "press", folder / fuzzing.OUTPUT / "a.h5"
    out.parent.mkdir()
    given = {"ball_mm": 4.7, "px_per_mm": 5.0, "output": out, "height_px": 16, "width_px": 16}
    ball_press.import_folder(where, folder / "labels.csv", where / "background.png", **given)


def presses_command(folder: Path) -> list:
    where = folder / "press"
    given = ["--labels", folder / "labels.csv", "--background", where / "background.png", "--ball-mm", 4.7]
    return ["import", "ball-press", where, *given, "--px-per-mm", 5, "-o", folder / fuzzing.OUTPUT / "a.h5"]


@st.composite
def force_recordings(draw) -> Case:
    """Six photographs with forces, one damaged, a link, missing, or one more."""
    files: dict[str, Content] = {f"{k}.png": PICTURES[0] for k in range(6)}
    name = draw(st.sampled_from(tuple(files)))
    match draw(st.integers(0, 3)):
        case 0 | 1:
            files[name] = draw(PHOTOGRAPHS)
        case 2:
            files[name] = draw(st.sampled_from(LINKS))
        case _:
            files[draw(st.sampled_from(("9.png", "x.jpg", ".x.png", "3.5.png")))] = draw(PHOTOGRAPHS)
    labels = draw(st.one_of(st.just(FORCES.encode()), changed_bytes([FORCES.encode()])))
    return outside({f"press/{key}": value for key, value in files.items()} | {"forces.csv": labels})


def import_forces(folder: Path) -> None:
    out = folder / fuzzing.OUTPUT / "a.h5"
    out.parent.mkdir()
    force_recording.import_recordings(
        [(folder / "press", folder / "forces.csv")],
        background_frames=2,
        pitch_mm=0.1,
        output=out,
        height_px=16,
        width_px=16,
        progress=False,
    )


def forces_command(folder: Path) -> list:
    given = ["--forces", folder / "forces.csv", "--background-frames", 2, "--pitch-mm", 0.1, "--no-progress"]
    return ["import", "force", folder / "press", *given, "-o", folder / fuzzing.OUTPUT / "a.h5"]


@cache
def protocol() -> bytes:
    surface = cad.of_scene(SCENE.sensor)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "poses.csv"
        z = surface.first_touch_mm(5.0, 0.0, 0.0) - 0.2
        poses.write(
            path,
            [Pose("train", 0, 0, 0, z, 0.5, 0, 0, 0, 0, 0.5), Pose("test", 1, 0, 0, z, 1, 0, 0, 0, 0, 1)],
        )
        return path.read_bytes()


def saved(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


@st.composite
def machine_recordings(draw) -> Case:
    frame = saved(PICTURE[:16, :16])
    files: dict[str, Content] = {f"{name}.npy": frame for name in ("000000", "000001", "background")}
    table = protocol()
    name = draw(st.sampled_from(tuple(files)))
    others = (saved(PICTURE), saved(PICTURE[:16, :16] + 0.5), saved(np.zeros((16, 16, 4), np.uint8)), b"")
    match draw(st.integers(0, 4)):
        case 0:
            files[name] = draw(st.one_of(changed_bytes([frame]), st.sampled_from(others)))
        case 1:
            files[name] = draw(st.sampled_from(LINKS))
        case 2:
            del files[name]
            files[name.replace("npy", "png")] = draw(PHOTOGRAPHS)
        case _:
            table = draw(changed_bytes([table], (b",", b"\n", b"1e9", b"-1", b"nan", b"9" * 30)))
    return outside({f"press/{key}": value for key, value in files.items()} | {"press/poses.csv": table})


def import_machine(folder: Path) -> None:
    out = folder / fuzzing.OUTPUT / "a.h5"
    out.parent.mkdir()
    surface = cad.of_scene(SCENE.sensor)
    cnc.import_recording(SCENE, folder / "press", surface, out, ball_mm=5.0, progress=False)


def surface(count: int = 2, declared: int | None = None) -> bytes:
    """A square of two triangles as binary STL, which may declare another number of them."""
    corners = [(-5, -5, 1), (5, -5, 1), (5, 5, 1.5)], [(-5, -5, 1), (5, 5, 1.5), (-5, 5, 1)]
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *sum(triangle, ()), 0) for triangle in corners[:count])
    return b"\0" * 80 + struct.pack("<I", count if declared is None else declared) + body


TEXT_STL = b"""\
solid a
facet normal 0 0 1
outer loop
vertex -5 -5 1
vertex 5 -5 1
vertex 5 5 1
endloop
endfacet
endsolid a
"""
SURFACES = [surface(), TEXT_STL]
STL = st.one_of(
    changed_bytes(SURFACES, (b"vertex 1e30 0 0\n", b"nan", b"solid", struct.pack("<f", np.nan))),
    st.sampled_from([surface(declared=n) for n in (0, 1, 3, 2**31, 2**32 - 1, 10**8)]),
)


READERS = [
    Reader("photograph", PHOTOGRAPHS.map(lambda c: {"a.png": c}), lambda f: photograph(f / "a.png")),
    Reader(
        "video",
        st.one_of(st.deferred(lambda: changed_bytes(videos())), st.sampled_from((PLAYLIST, CONCAT))).map(
            lambda c: {"press.mp4": c}
        ),
        frames_of,
        count=10_000,
    ),
    Reader("folder of ball presses", ball_presses(), import_presses, presses_command, count=5_000),
    Reader("photographs with a force gauge", force_recordings(), import_forces, forces_command, count=5_000),
    Reader("recording of a machine", machine_recordings(), import_machine, count=5_000),
    Reader("CAD surface", STL.map(lambda c: {"a.stl": c}), lambda f: cad.of_file(SCENE.sensor, f / "a.stl")),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
