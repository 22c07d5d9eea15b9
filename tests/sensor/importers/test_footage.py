import io
import struct
import sys
import zlib

import numpy as np
import pytest
from PIL import Image

from fastac.sensor.importers.footage import ImportFailure, Photographs, Video, footage, photograph


def film(path, images, codec="ffv1"):
    """Write images (N, height, width, 3) BGR uint8 as a video, without loss unless the codec has one."""
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.height, stream.width = images.shape[1:3]
        stream.pix_fmt = "bgr0" if codec == "ffv1" else "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path


@pytest.fixture
def images():
    return np.random.default_rng(1).integers(0, 256, (12, 24, 32, 3), dtype=np.uint8)


def test_photographs_come_in_the_order_of_their_numbers(tmp_path, images):
    for k, image in enumerate(images):
        Image.fromarray(np.ascontiguousarray(image[..., ::-1])).save(tmp_path / f"f{k}.png")
    (tmp_path / "forces.csv").write_text("frame\n")
    found = footage(tmp_path)
    assert isinstance(found, Photographs)
    assert found.index_of("f10.png") == 10
    assert found.index_of("forces.csv") is None
    np.testing.assert_array_equal(np.stack(list(found)), images)


def test_folders_need_no_video_library(tmp_path, images, monkeypatch):
    Image.fromarray(images[0]).save(tmp_path / "f.png")
    monkeypatch.setitem(sys.modules, "av", None)
    assert len(list(footage(tmp_path))) == 1


def test_videos_give_their_frames_as_often_as_wanted(tmp_path, images):
    found = footage(film(tmp_path / "v.mkv", images))
    assert isinstance(found, Video)
    assert found.index_of("f0.png") is None
    for _ in range(2):
        np.testing.assert_array_equal(np.stack(list(found)), images)


def test_refuses_what_is_no_footage(tmp_path, images):
    for path, message in (
        (tmp_path / "no.mp4", r"no\.mp4: no such file or folder"),
        (tmp_path, r"no photographs: expected files of \.bmp"),
    ):
        with pytest.raises(ImportFailure, match=message):
            footage(path)
    (tmp_path / "text.mp4").write_text("frame,force_z_n\n" * 100)
    with pytest.raises(ImportFailure, match=r"text\.mp4: not a readable video: Invalid data"):
        list(footage(tmp_path / "text.mp4"))
    import av

    with av.open(str(tmp_path / "sound.wav"), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        frame.rate = 8000
        container.mux(stream.encode(frame))
    with pytest.raises(ImportFailure, match=r"sound\.wav: no video in this file"):
        list(footage(tmp_path / "sound.wav"))


def declaring(size: int) -> bytes:
    """A PNG of 4 × 4 pixels that says it has `size` × `size`."""
    file = io.BytesIO()
    Image.new("RGB", (4, 4)).save(file, "PNG")
    content = bytearray(file.getvalue())
    content[16:24] = struct.pack(">II", size, size)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    return bytes(content)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (2000, r"size = 2000 x 2000 px: more than its \d+ bytes can hold"),
        (12_000, "not a readable image: Image size"),
        (2**31 - 1, "not a readable image: Image size"),
    ],
)
def test_pictures_that_declare_more_pixels_than_they_have(tmp_path, size, message):
    (tmp_path / "a.png").write_bytes(declaring(size))
    with pytest.raises(ImportFailure, match=rf"a\.png: {message}"):
        photograph(tmp_path / "a.png")


def test_an_empty_picture_may_be_small(tmp_path):
    Image.new("RGB", (1000, 1000)).save(tmp_path / "a.png")
    Image.new("RGB", (1000, 1000)).save(tmp_path / "a.jpg")
    assert photograph(tmp_path / "a.png").shape == photograph(tmp_path / "a.jpg").shape == (1000, 1000, 3)


def test_formats_that_start_programs_are_not_opened(tmp_path):
    """Pillow gives EPS files, by their content, to Ghostscript."""
    Image.new("RGB", (4, 4)).save(tmp_path / "a.eps")
    (tmp_path / "a.eps").rename(tmp_path / "a.png")
    with pytest.raises(ImportFailure, match=r"a\.png: not a readable image: cannot identify"):
        photograph(tmp_path / "a.png")


@pytest.mark.parametrize(
    "listing", ["#EXTM3U\n#EXTINF:1,\nwhole.mkv\n", "ffconcat version 1.0\nfile whole.mkv\n"]
)
def test_playlists_are_no_videos(tmp_path, images, listing):
    """FFmpeg would read the files, and the addresses, that they name."""
    film(tmp_path / "whole.mkv", images)
    (tmp_path / "list.mp4").write_text(listing + "#EXT-X-ENDLIST\n" * listing.startswith("#"))
    with pytest.raises(ImportFailure, match=r"list\.mp4: not a readable video"):
        list(footage(tmp_path / "list.mp4"))


def test_a_video_whose_texts_are_not_unicode(tmp_path, images):
    path = film(tmp_path / "v.mkv", images)
    content = path.read_bytes()
    assert b"Lavf" in content
    path.write_bytes(content.replace(b"Lavf", b"La\xff\xfe"))
    assert len(list(footage(path))) == len(images)


def test_photographs_outside_the_folder(tmp_path, images):
    (tmp_path / "folder").mkdir()
    Image.fromarray(images[0]).save(tmp_path / "secret.png")
    (tmp_path / "folder" / "a.png").symlink_to("../secret.png")
    with pytest.raises(ImportFailure, match=r"folder: 'a\.png': not a file inside this folder"):
        footage(tmp_path / "folder")
