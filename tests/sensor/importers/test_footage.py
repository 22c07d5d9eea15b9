import sys

import numpy as np
import pytest
from PIL import Image

from fastac.sensor.importers.footage import ImportFailure, Photographs, Video, footage


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
