"""A recording by the virtual rig is imported with its own ground truth; bad ones give one-line errors."""

from functools import partial

import numpy as np
import pytest
from PIL import Image

from fastac.models.vision.markers import Markers
from fastac.scenes.schema import parse
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor import dataset
from fastac.sensor.fingertip import generate
from fastac.sensor.importers import cnc
from fastac.sensor.importers.cad import of_file, of_scene
from fastac.sensor.importers.cnc_frames import CncFrames
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.optics.raw10 import pack

TEXT = """
name = "rig"
outputs = ["depth", "force_xyz"]
[sensor]
geometry = "fingertip"
height_px = 48
width_px = 48
pitch_mm = 0.33
frames = "raw10"
[sensor.elastomer]
mechanics = "fem"
friction = 1.0
elements = 20
layers = 2
[sensor.markers]
spacing_mm = 3.0
radius_mm = 0.8
[protocol]
train_grid = 2
validation_grid = 1
test_grid = 1
tangential_shares = [0.3]
loads_n = [1.0, 1.5]
ball_mm = 8.0
"""
ORIGIN = (100.0, -20.0, 55.5)


@pytest.fixture(scope="module")
def scene():
    return parse(TEXT, origin="rig")


@pytest.fixture(scope="module")
def own(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    generate(scene, folder / "d.h5", store=folder / "cache", progress=False, processes=1)
    return dataset.read(folder / "d.h5", scene)


@pytest.fixture
def recording(scene, own, tmp_path):
    cnc.write_recording(scene, own, tmp_path / "rec", ORIGIN, progress=False)
    return tmp_path / "rec"


def imported(scene, folder, output, **keys):
    marker_finder_of = partial(Markers.of_background, sensor=scene.sensor) if scene.sensor.markers else None
    keys = {
        "marker_finder_of": marker_finder_of,
        "ball_mm": 8.0,
        "origin_mm": ORIGIN,
        "progress": False,
        **keys,
    }
    cnc.import_recording(scene, folder, keys.pop("cad", of_scene(scene.sensor)), output, **keys)
    return dataset.read(output, scene)


def test_the_round_trip(scene, own, recording, tmp_path):
    found = imported(scene, recording, tmp_path / "d.h5")
    n = len(own)
    assert len(found) == n + 1, "the background is the last sample"
    np.testing.assert_array_equal(found.raw10[:n], own.raw10)
    np.testing.assert_array_equal(found.raw10[n], own.background)
    np.testing.assert_array_equal(found.background, own.background)
    np.testing.assert_array_equal(found.split[:n], own.split)
    np.testing.assert_allclose(found.force_n[:n], own.force_n, atol=1e-6)
    np.testing.assert_array_equal(found.force_n[n], 0)
    np.testing.assert_array_equal(found.rest_depth_mm, own.rest_depth_mm)

    vertical = (own.indenter["tangential_x_n"] == 0) & (own.indenter["tangential_y_n"] == 0)
    assert found.valid[:n][vertical].any(axis=(1, 2)).all()
    assert not found.valid[:n][~vertical].any()
    where = found.valid[:n]
    np.testing.assert_allclose(found.depth_mm[:n][where], own.depth_mm[where], atol=2e-6)
    np.testing.assert_allclose(found.normals[:n][where], own.normals[where], atol=2e-6)
    assert found.valid[n].all()
    np.testing.assert_array_equal(found.depth_mm[n], own.rest_depth_mm)
    for key in ("x_mm", "y_mm", "z_mm", "load_n", "tangential_x_n"):
        np.testing.assert_allclose(found.indenter[key][:n], own.indenter[key], atol=1e-6)


def test_markers_are_found_where_they_are(scene, own, recording, tmp_path):
    found = imported(scene, recording, tmp_path / "d.h5")
    rest = found.markers_px[-1]
    moved = own.markers_px
    assert rest.shape == moved.shape[1:]
    distance = np.linalg.norm(found.markers_px[:-1] - moved, axis=-1)
    assert np.median(distance) < 0.15
    assert distance.max() < 1.5


def test_the_skin_may_come_from_a_height_map(scene, own, recording, tmp_path):
    axis = np.linspace(-8, 8, 97)
    np.save(tmp_path / "skin.npy", of_scene(scene.sensor).depth_at_mm(*np.meshgrid(axis, axis)) - 7)
    cad = of_file(scene.sensor, tmp_path / "skin.npy", axis[1] - axis[0])
    found = imported(scene, recording, tmp_path / "d.h5", cad=cad)
    where = found.valid[:-1]
    assert where.any()
    np.testing.assert_allclose(found.depth_mm[:-1][where], own.depth_mm[where], atol=2e-6)
    np.testing.assert_allclose(found.rest_depth_mm, own.rest_depth_mm, atol=1e-3)


def test_what_the_machine_is_told(scene):
    rows = cnc.planned_poses(scene, of_scene(scene.sensor), ORIGIN)
    assert [row.index for row in rows] == list(range(6 * 2 * 5))
    assert [row.split for row in rows[:40]] == ["train"] * 40
    assert (rows[0].x_mm, rows[0].y_mm) == pytest.approx((100 - 3.855, -20 - 3.855))
    middle = rows[40]
    skin = of_scene(scene.sensor).first_touch_mm(8.0, middle.x_mm - 100, middle.y_mm + 20)
    assert middle.z_mm == pytest.approx(55.5 + skin)
    assert sum(row.is_vertical for row in rows) == 12


def test_nothing_is_overwritten_and_a_layer_has_no_pose(
    scene, own, recording, tiny_scene, tiny_data, tmp_path
):
    with pytest.raises(ImportFailure, match="not empty"):
        cnc.write_recording(scene, own, recording, ORIGIN, progress=False)
    with pytest.raises(ImportFailure, match="mechanics = 'layer'"):
        cnc.write_recording(tiny_scene, tiny_data, tmp_path / "new", ORIGIN, progress=False)


def spoil_first(folder, column, value):
    """Set a value in the first row of poses.csv."""
    head, row, *others = (folder / "poses.csv").read_text().splitlines()
    values = row.split(",")
    values[head.split(",").index(column)] = value
    (folder / "poses.csv").write_text("\n".join([head, ",".join(values), *others]))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "000003.raw").unlink(), r"000003: no such file: expected \.raw or \.npy"),
        (lambda f: (f / "background.raw").unlink(), "background: no such file"),
        (lambda f: (f / "poses.csv").unlink(), "poses.csv: no such file"),
        (lambda f: (f / "000003.raw").write_bytes(b"123"), "000003.raw: RAW10: 3 bytes: truncated"),
        (lambda f: (f / "000003.raw").write_bytes(bytes(99999)), "000003.raw: .*too long"),
        (lambda f: (f / "poses.csv").write_text("colour,index\nred,0"), "split: missing column"),
        (lambda f: spoil_first(f, "x_mm", "195"), "line 2: x_mm = 95: outside the skin"),
        (lambda f: spoil_first(f, "z_mm", "56"), r"line 2: z_mm = 0\.5: sinks .* into 3 mm of elastomer"),
        (lambda f: spoil_first(f, "force_z_n", "-0.5"), "line 2: force_z_n = -0.5: expected more"),
        (
            lambda f: CncFrames(f, parse(TEXT, origin="").sensor).write(
                "000002", np.full((192, 192), 500, "u2")
            ),
            "line 4: markers: all 25 lost",
        ),
        (
            lambda f: CncFrames(f, parse(TEXT, origin="").sensor).write(
                "background", np.full((192, 192), 500, "u2")
            ),
            r"background: markers of the reference: \(0, 2\)",
        ),
    ],
)
def test_refuses_a_bad_recording_in_one_line(scene, recording, tmp_path, spoil, message):
    spoil(recording)
    with pytest.raises(ImportFailure, match=message) as error:
        imported(scene, recording, tmp_path / "d.h5")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "d.h5").exists()


def test_samples_with_lost_markers_can_be_left_out(scene, own, recording, tmp_path):
    CncFrames(recording, scene.sensor).write("000002", np.full((192, 192), 500, np.uint16))
    found = imported(scene, recording, tmp_path / "d.h5", skip_lost=True)
    assert (len(found), found.left_out) == (len(own), 1)
    np.testing.assert_array_equal(found.raw10[2], own.raw10[3])


def test_a_larger_raw_image_is_cut_to_the_window(scene, own, tmp_path):
    large = np.zeros((200, 240), np.uint16)
    large[4:196, 24:216] = own.raw10[0]
    np.save(tmp_path / "000000.npy", large)
    frames = CncFrames(tmp_path, scene.sensor)
    np.testing.assert_array_equal(frames.read("000000"), own.raw10[0])
    np.save(tmp_path / "000001.npy", large[:, :100])
    with pytest.raises(ImportFailure, match=r"000001\.npy: crop_px width = 192: expected at most 100"):
        frames.read("000001")
    np.save(tmp_path / "000003.npy", large[:195, :239])
    with pytest.raises(ImportFailure, match=r"000003\.npy: 239 x 195 px: expected multiples of 4"):
        frames.read("000003")
    (tmp_path / "000004.raw").write_bytes(pack(large).tobytes())
    whole = CncFrames(tmp_path, scene.sensor, (200, 240))
    np.testing.assert_array_equal(whole.read("000004"), own.raw10[0])
    np.save(tmp_path / "000002.npy", large.astype(np.int32))
    with pytest.raises(ImportFailure, match=r"000002\.npy: int32 .*expected uint16"):
        frames.read("000002")


class TestChannels:
    SENSOR = Sensor(geometry="flat", height_px=16, width_px=20)

    def test_photographs_and_arrays_are_the_same(self, tmp_path):
        frame = np.random.default_rng(1).integers(0, 256, (16, 20, 4), dtype=np.uint8)
        frames = CncFrames(tmp_path, self.SENSOR)
        frames.write("000000", frame)
        Image.fromarray(frame[..., 2::-1]).save(tmp_path / "000001.png")
        Image.fromarray(frame[..., 3]).save(tmp_path / "000001.nir.png")
        np.testing.assert_array_equal(frames.read("000000"), frame)
        np.testing.assert_array_equal(frames.read("000001"), frame)
        three = CncFrames(tmp_path, self.SENSOR.model_copy(update={"channels": "bgr"}))
        np.testing.assert_array_equal(three.read("000001"), frame[..., :3])

    def test_refuses_what_is_of_another_kind(self, tmp_path):
        frames = CncFrames(tmp_path, self.SENSOR)
        np.save(tmp_path / "000000.npy", np.zeros((16, 20, 3), np.uint8))
        with pytest.raises(ImportFailure, match=r"000000\.npy: uint8 .*expected uint8 \(16, 20, 4\)"):
            frames.read("000000")
        Image.new("RGB", (20, 16)).save(tmp_path / "000001.png")
        with pytest.raises(ImportFailure, match=r"000001\.nir\.png: no such file, and the scene has NIR"):
            frames.read("000001")
        Image.new("L", (20, 16)).save(tmp_path / "000001.nir.png")
        assert frames.read("000001").shape == (16, 20, 4)
        Image.new("L", (20, 15)).save(tmp_path / "000001.nir.png")
        with pytest.raises(ImportFailure, match=r"000001\.nir\.png: size = "):
            frames.read("000001")
        Image.new("RGB", (20, 16)).save(tmp_path / "000001.nir.png")
        with pytest.raises(ImportFailure, match=r"000001\.nir\.png: mode = RGB: expected an 8-bit grey"):
            frames.read("000001")
