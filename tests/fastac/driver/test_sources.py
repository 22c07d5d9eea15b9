"""Frames of videos and photographs, fitted as the importers did with those the sensor was trained on."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from PIL import Image

from fastac.driver.fitting import Fitting, fitting_of
from fastac.driver.sources import SourceError, open_source
from fastac.models.random_bundle import scene
from fastac.sensor import dataset
from fastac.sensor.importers.ball_press import import_folder

SIZE = (24, 40)  # height and width: the sensor's 16 × 16 have rows above and below, some of them in part


def photograph_of(seed: int) -> np.ndarray:
    """(24, 40, 3) uint8, B, G, R: smooth, as a gel is."""
    v, u = np.indices(SIZE)
    waves = [80 + 40 * np.sin((seed + band) + u / 9 + v / 7) for band in range(3)]
    return np.rint(np.stack(waves, axis=-1)).astype(np.uint8)


def save(path: Path, photograph: np.ndarray) -> None:
    Image.fromarray(photograph[..., ::-1]).save(path)


def write_video(path: Path, photographs: list[np.ndarray], rate: int = 25) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=rate, options={"slices": "4"})
        stream.width, stream.height, stream.pix_fmt = photographs[0].shape[1], photographs[0].shape[0], "bgr0"
        for photograph in photographs:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(photograph, "bgr24")))
        container.mux(stream.encode())


@pytest.fixture(scope="module")
def sensor():
    return scene(("depth",), mode="difference")


@pytest.fixture(scope="module")
def build(tmp_path_factory) -> Path:
    """A folder with data.h5, imported from presses on a gel; the photographs are in `photos`."""
    folder = tmp_path_factory.mktemp("build")
    photos = folder / "photos"
    photos.mkdir()
    rows = ["image,center_x_px,center_y_px,radius_px,split"]
    for k in range(3):
        save(photos / f"{k}.png", photograph_of(k + 1))
        rows.append(f"{k}.png,20,12,4,train")
    save(photos / "background.png", photograph_of(0))
    (folder / "labels.csv").write_text("\n".join(rows))
    scale = {"ball_mm": 5.0, "px_per_mm": 16.0, "height_px": 16, "width_px": 16}
    arguments = photos, folder / "labels.csv", photos / "background.png"
    import_folder(*arguments, output=folder / "data.h5", **scale)
    return folder


@pytest.fixture(scope="module")
def imported(build):
    return dataset.read(build / "data.h5")


def frames(source) -> np.ndarray:
    return np.array(list(source.frames)).astype(int)


def trained_on(background: np.ndarray, **provenance):
    """A pipeline as far as a fitting reads it."""
    return SimpleNamespace(background=background, provenance=provenance)


@pytest.fixture(scope="module")
def fitting(imported) -> Fitting:
    return fitting_of(trained_on(imported.background, photograph_px=list(imported.photograph_px)))


def test_a_dataset_says_how_large_its_photographs_were(imported, fitting):
    assert imported.photograph_px == fitting.photograph_px == SIZE


@pytest.mark.parametrize("known", [{}, *({"photograph_px": size} for size in (None, [1], ["a", 2], [0, 2]))])
def test_a_bundle_that_does_not_say_it(imported, known):
    assert fitting_of(trained_on(imported.background, **known)).photograph_px is None


def test_a_video_becomes_what_the_importer_made_of_the_same_photographs(sensor, fitting, imported, tmp_path):
    photographs = [photograph_of(k + 1) for k in range(3)]
    write_video(tmp_path / "press.mkv", photographs)
    source = open_source(str(tmp_path / "press.mkv"), sensor, fitting=fitting)
    assert source.frames_per_second == 25
    found, expected = frames(source), imported.frames[:3].astype(int)
    np.testing.assert_allclose(found, expected, atol=1)  # the background's rim is known in whole numbers
    inside = slice(4, -4)  # rows that the photographs cover
    np.testing.assert_array_equal(found[:, inside], expected[:, inside])
    np.testing.assert_array_equal(found[:, [0, 1, -2, -1]], expected[:, [0, 1, -2, -1]])


def test_photographs_of_a_folder_are_fitted_too(sensor, fitting, imported, tmp_path):
    for k in (2, 10):
        save(tmp_path / f"{k}.bmp", photograph_of(k))
    save(tmp_path / "background.png", photograph_of(0))
    source = open_source(str(tmp_path), sensor, fitting=fitting)
    assert source.count == 2
    np.testing.assert_allclose(source.background.astype(int), imported.background.astype(int), atol=1)
    write_video(tmp_path / "same.mkv", [photograph_of(2), photograph_of(10)])
    video = open_source(str(tmp_path / "same.mkv"), sensor, fitting=fitting)
    np.testing.assert_array_equal(frames(source), frames(video))


def test_frames_of_the_sensor_s_size_are_not_touched(sensor, imported, tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (2, 16, 16, 3), dtype=np.uint8)
    write_video(tmp_path / "small.mkv", list(noise))
    for fitting in (None, Fitting(imported.background, any_size=True)):
        np.testing.assert_array_equal(
            frames(open_source(str(tmp_path / "small.mkv"), sensor, fitting=fitting)), noise
        )


def test_other_sizes_are_refused_unless_they_are_to_be_fitted(sensor, fitting, imported, tmp_path):
    path = tmp_path / "large.mkv"
    write_video(path, [np.kron(photograph_of(1), np.ones((2, 2, 1), np.uint8))])
    wanted = f"{path}: frame 0: 80 x 48 px: the sensor's frames are 16 x 16 px"
    for known, more in [
        (None, ""),
        (Fitting(imported.background), "; --fit resamples others too"),
        (fitting, ", resampled from 40 x 24 px; --fit resamples others too"),
    ]:
        with pytest.raises(SourceError) as refused:
            list(open_source(str(path), sensor, fitting=known).frames)
        assert str(refused.value) == wanted + more
    anything = replace(fitting, any_size=True)
    (found,) = frames(open_source(str(path), sensor, fitting=anything))
    np.testing.assert_allclose(found, imported.frames[0].astype(int), atol=1)


def test_a_sensor_with_nir_takes_no_video(imported, tmp_path):
    write_video(tmp_path / "press.mkv", [photograph_of(1)])
    with pytest.raises(SourceError, match="the scene's sensor sends B, G, R, NIR"):
        open_source(
            str(tmp_path / "press.mkv"),
            scene(("depth",), channels="bgr+nir"),
            fitting=Fitting(imported.background, any_size=True),
        )


def test_a_video_of_the_photographs_through_the_whole_stream(sensor, tmp_path):
    """A bundle that knows the size of its photographs: their video is fitted without being asked for."""
    from fastac.models.integer import bundle
    from fastac.models.random_bundle import random_bundle
    from fastac.streaming.session import open_session

    known = random_bundle(tmp_path / "random", sensor).pipeline
    bundle.save(tmp_path / "bundle", known.replace(provenance={"photograph_px": list(SIZE)}), {})
    path = tmp_path / "press.mkv"
    write_video(path, [photograph_of(1), photograph_of(2)], rate=40)
    with open_session(tmp_path, str(path)) as session:
        records = list(session.records())
    assert session.about.frames_per_second == 40
    assert [record.source_time_ns for record in records] == [0, 25_000_000]
    fitting = Fitting(known.background, SIZE)
    np.testing.assert_array_equal(records[1].image, fitting(photograph_of(2)))
