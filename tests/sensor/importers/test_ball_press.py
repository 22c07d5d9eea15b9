from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fastac.models.training import shown_slopes
from fastac.scenes.schema import load
from fastac.sensor.contact_circle import is_whole
from fastac.sensor.dataset import read
from fastac.sensor.importers.ball_press import import_folder
from fastac.sensor.importers.footage import ImportFailure

ROOT = Path(__file__).parents[3]
FOTS = ROOT.parent / "shared" / "data" / "fots"
HEADER = "image,center_x_px,center_y_px,radius_px,split\n"
BALL = {"ball_mm": 4.0, "px_per_mm": 10.0, "height_px": 32, "width_px": 32}


@pytest.fixture
def recording(tmp_path):
    """Two synthetic presses, 48 px wide and 64 px high, each of one colour, and a background of another
    one."""
    folder = tmp_path / "press"
    folder.mkdir()
    for name, colour in (("a.png", (200, 100, 50)), ("b.png", (0, 0, 255))):
        Image.new("RGB", (48, 64), colour).save(folder / name)
    Image.new("RGB", (48, 64), (90, 80, 70)).save(tmp_path / "background.png")
    (tmp_path / "press.csv").write_text(HEADER + "a.png,20,30,15,train\nb.png,24,31.5,12,test\n")
    return tmp_path


def imported(place, **changed):
    arguments = {**BALL, "output": place / "out.h5", **changed}
    import_folder(place / "press", place / "press.csv", place / "background.png", **arguments)
    return read(place / "out.h5")


def test_frames_are_bgr_on_the_background(recording):
    data = imported(recording)
    assert data.channels == ("B", "G", "R")
    assert data.frames.shape == (3, 32, 32, 3)
    assert data.pitch_mm == pytest.approx(0.2)
    assert data.source.startswith("recorded")
    inside = slice(4, 28)
    np.testing.assert_array_equal(data.frames[0][:, inside], np.full((32, 24, 3), (50, 100, 200)))
    for padding in (slice(0, 4), slice(28, 32)):
        np.testing.assert_array_equal(data.frames[:, :, padding], np.full((3, 32, 4, 3), (70, 80, 90)))
        assert not data.valid[:, :, padding].any()
    np.testing.assert_array_equal(data.background, np.full((32, 32, 3), (70, 80, 90)))


def test_the_background_is_the_flat_sample(recording):
    data = imported(recording)
    np.testing.assert_array_equal(data.split, ["train", "test", "train"])
    np.testing.assert_array_equal(data.frames[2], data.background)
    assert data.valid[2].sum() == 32 * 24
    np.testing.assert_array_equal(data.normals[2][data.valid[2]], np.tile([0, 0, 1], (32 * 24, 1)))
    assert np.isnan(data.indenter["center_px"][2]).all()
    assert np.isnan(data.indenter["radius_px"][2])
    assert data.force_n is None
    assert data.depth_mm is None


def test_the_skin_is_the_ball_inside_the_circle_and_unknown_outside(recording):
    data = imported(recording)
    assert data.indenter["center_px"][1] == pytest.approx([(24.5 - 24) / 2 + 15.5, 15.5])
    assert data.indenter["radius_px"][1] == 6
    np.testing.assert_array_equal(data.indenter["scale"], 2)
    v, u = np.indices((32, 32))
    x = (u - data.indenter["center_px"][1, 0]) * 0.2
    y = (v - 15.5) * 0.2
    r = np.hypot(x, y)
    np.testing.assert_array_equal(data.valid[1], r <= 1.2)
    inside = data.valid[1]
    # The ball's centre is outwards of the skin: the normal points at it.
    want = np.stack([-x, -y, np.sqrt(np.maximum(4 - r * r, 0))], axis=-1) / 2
    np.testing.assert_allclose(data.normals[1][inside], want[inside], atol=1e-6)
    assert np.isnan(data.normals[1][~inside]).all()


def test_circles_are_made_smaller(recording):
    data = imported(recording, radius_reduction_px=4)
    assert data.indenter["radius_px"][1] == 4
    v, u = np.indices((32, 32))
    r = np.hypot(u - data.indenter["center_px"][1, 0], v - 15.5)
    np.testing.assert_array_equal(data.valid[1], r <= 4)
    with pytest.raises(ImportFailure, match=r"radius_px = 12 - 12: expected more than 0"):
        imported(recording, radius_reduction_px=12)
    for reduction in (-1, np.nan):
        with pytest.raises(ImportFailure, match=r"radius_reduction_px = (-1|nan): expected 0 or more"):
            imported(recording, radius_reduction_px=reduction)


def test_bad_circles_can_be_skipped(recording):
    rows = "a.png,24,30,20,train\nb.png,24,31.5,12,test\na.png,5,30,15,train\n"
    (recording / "press.csv").write_text(HEADER + rows)
    with pytest.raises(ImportFailure, match="--skip-bad-circles leaves such presses out"):
        imported(recording)
    data = imported(recording, skip_bad_circles=True)
    assert (len(data), data.left_out, data.split[0]) == (2, 2, "test")
    (recording / "press.csv").write_text(HEADER + "a.png,24,30,20,train\n")
    with pytest.raises(
        ImportFailure, match="no circle of 1 presses is smaller than the ball and in the image"
    ):
        imported(recording, skip_bad_circles=True)


def test_circles_can_be_cut_at_the_photograph_s_rim(recording):
    """Where the skin is seen it lies against the ball as it does elsewhere. The photograph is 48 px wide and
    lies in the middle of 64."""
    (recording / "press.csv").write_text(HEADER + "a.png,5,30,15,train\nb.png,24,31.5,12,test\n")
    with pytest.raises(ImportFailure, match="--cut-circles takes what is in the image, --skip-bad-circles"):
        imported(recording)
    data = imported(recording, cut_circles=True)
    assert (len(data), data.left_out) == (3, 0)
    v, u = np.indices((32, 32))
    r = np.hypot(u - data.indenter["center_px"][0, 0], v - data.indenter["center_px"][0, 1])
    np.testing.assert_array_equal(data.valid[0], (r <= 7.5) & (u >= 4))
    assert data.valid[0].sum() < (r <= 7.5).sum()
    assert [is_whole(data, k) for k in range(3)] == [False, True, False]
    (recording / "press.csv").write_text(HEADER + "a.png,-1,30,15,train\n")
    with pytest.raises(
        ImportFailure, match="center_x_px = -1: not in the image of 48 px; --skip-bad-circles"
    ):
        imported(recording, cut_circles=True)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (
            "image,center_x_px,center_y_px,split\na.png,20,30,train\n",
            r"press\.csv: radius_px: missing column",
        ),
        (HEADER, "expected at least one row"),
        (HEADER + "a.png,20,30,15,train\nc.png,20,30,15,train\n", r"line 3: image = 'c\.png': not in"),
        (
            HEADER + "../background.png,20,30,15,train\n",
            r"line 2: image = '\.\./background\.png': not inside",
        ),
        (HEADER + "/etc/hostname,20,30,15,train\n", "line 2: image = '/etc/hostname': not inside"),
        (HEADER + "a\0.png,20,30,15,train\n", r"line 2: image = 'a\\x00\.png': not inside"),
        (HEADER + "a.png,20,3O,15,train\n", "line 2: center_y_px = '3O': expected a number"),
        (HEADER + "a.png,20,nan,15,train\n", "line 2: center_y_px = 'nan': expected a number"),
        (HEADER + "a.png,20,30\n", "line 2: radius_px: missing value"),
        (HEADER + "a.png,20,30,15,dev\n", "line 2: split = 'dev': expected one of train"),
        (HEADER + "a.png,20,30,0,train\n", "line 2: radius_px = 0: expected more than 0"),
        (
            HEADER + "a.png,24,30,20,train\n",
            "radius_px = 20: 2.000 mm .* less than the ball's radius of 2 mm",
        ),
        (HEADER + "a.png,10,30,15,train\n", "center_x_px = 10: a circle of radius 15 px leaves the image"),
        (HEADER + "a.png,20,60,15,train\n", "center_y_px = 60: a circle of radius 15 px leaves the image"),
    ],
)
def test_refuses_bad_labels(recording, labels, message):
    (recording / "press.csv").write_text(labels)
    with pytest.raises(ImportFailure, match=message) as error:
        imported(recording)
    assert "\n" not in str(error.value)
    assert not (recording / "out.h5").exists()


def test_refuses_bad_images(recording):
    Image.new("RGB", (64, 48)).save(recording / "press" / "b.png")
    with pytest.raises(ImportFailure, match=r"b\.png: size = 64 x 48 px: expected the background's 48 x 64"):
        imported(recording)
    Image.new("L", (48, 64)).save(recording / "press" / "b.png")
    with pytest.raises(ImportFailure, match=r"b\.png: mode = L: expected an 8-bit RGB image"):
        imported(recording)
    (recording / "press" / "b.png").write_bytes((recording / "press" / "a.png").read_bytes()[:60])
    with pytest.raises(ImportFailure, match=r"b\.png: not a readable image"):
        imported(recording)
    (recording / "background.png").unlink()
    with pytest.raises(ImportFailure, match=r"background\.png: no such file"):
        imported(recording)


def test_refuses_impossible_scales(recording):
    with pytest.raises(ImportFailure, match="px_per_mm = 0: expected more than 0"):
        imported(recording, px_per_mm=0)
    with pytest.raises(ImportFailure, match="ball_mm = -4: expected more than 0"):
        imported(recording, ball_mm=-4.0)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    if not FOTS.is_dir():
        pytest.skip(f"real photographs are not at {FOTS}")
    output = tmp_path_factory.mktemp("fots") / "fots.h5"
    import_folder(
        FOTS / "press",
        FOTS / "press.csv",
        FOTS / "background.png",
        ball_mm=4.7,
        px_per_mm=19.58,
        output=output,
    )
    return read(output, load(ROOT / "scenes" / "gelsight.toml"))


def test_real_photographs_fit_their_scene(photographs):
    assert photographs.pitch_mm == pytest.approx(2.5 / 19.58)
    assert len(photographs.indices("train")) == 34
    assert len(photographs.indices("test")) == 9
    change = np.abs(photographs.frames.astype(int) - photographs.background).max(axis=-1)
    assert change[:, :, :16].max() == change[:, :, -16:].max() == 0
    change, inside = change[:42, :, 16:-16], photographs.valid[:42, :, 16:-16]
    assert change[inside].mean() > 2 * change[~inside].mean()


def test_real_photographs_show_their_slopes_without_labels(photographs):
    """A linear model that is fitted to the labels has correlations of 0.73 and 0.78 with them."""
    found = shown_slopes.agreement(photographs)
    assert np.diagonal(found).min() > 0.65
    assert np.abs(found[[0, 1], [1, 0]]).max() < 0.1
    assert shown_slopes.doubt(found) is None


def test_real_photographs_shade_as_their_normals_say(photographs):
    """A linear model from colours to slopes, fitted to some presses, holds on the others."""

    def pixels(indices):
        where = photographs.valid[indices]
        n = photographs.normals[indices][where].astype(float)
        change = (photographs.frames[indices].astype(float) - photographs.background)[where]
        steep = n[:, 2] < 0.6
        return np.c_[change, np.ones(len(change))][~steep], (-n[:, :2] / n[:, 2:])[~steep]

    colours, slopes = pixels(photographs.indices("train")[:-1])
    fit = np.linalg.lstsq(colours, slopes)[0]
    colours, slopes = pixels(photographs.indices("test"))
    unexplained = ((slopes - colours @ fit) ** 2).mean(axis=0) / slopes.var(axis=0)
    assert np.all(unexplained < 0.5)
