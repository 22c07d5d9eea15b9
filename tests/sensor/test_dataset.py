import h5py
import numpy as np
import pytest

from fastac.scenes.schema import parse
from fastac.sensor.dataset import DatasetError, read, write

N, H, W = 3, 16, 20


def content():
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(N, H, W, 3)) + np.array([0, 0, 5])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return {
        "pitch_mm": 0.25,
        "channels": ("B", "G", "R", "NIR"),
        "source": "simulated: a test",
        "background": rng.integers(0, 256, (H, W, 4), dtype=np.uint8),
        "frames": rng.integers(0, 256, (N, H, W, 4), dtype=np.uint8),
        "split": np.array(["train", "test", "train"]),
        "normals": normals,
        "depth_mm": rng.normal(size=(N, H, W)),
        "valid": rng.random((N, H, W)) > 0.2,
        "force_n": rng.normal(size=(N, 3)),
        "indenter": {"center_px": rng.normal(size=(N, 2)), "ball_mm": np.array([5.0, 5.0, np.nan])},
        "rest_depth_mm": rng.normal(size=(H, W)),
    }


def scene(**changed):
    keys = {"channels": "bgr+nir", "height_px": H, "width_px": W, "pitch_mm": 0.25, **changed}
    sensor = "\n".join(f"{key} = {value!r}" for key, value in keys.items())
    text = f'name = "tiny"\noutputs = ["normals"]\n[sensor]\ngeometry = "flat"\n{sensor}\n'
    return parse(text, origin="tiny")


@pytest.fixture
def path(tmp_path):
    write(tmp_path / "d.h5", **content())
    return tmp_path / "d.h5"


def test_reads_what_was_written(path):
    data, want = read(path, scene()), content()
    assert len(data) == N
    assert (data.pitch_mm, data.channels, data.source) == (want["pitch_mm"], want["channels"], want["source"])
    for key in ("background", "frames", "split", "valid"):
        np.testing.assert_array_equal(getattr(data, key), want[key])
    for key in ("normals", "depth_mm", "force_n", "rest_depth_mm"):
        np.testing.assert_array_equal(getattr(data, key), want[key].astype(np.float32))
    assert data.indenter.keys() == want["indenter"].keys()
    for key, array in want["indenter"].items():
        np.testing.assert_array_equal(data.indenter[key], array)
    np.testing.assert_array_equal(data.indices("train"), [0, 2])
    assert len(data.indices("validation")) == 0
    with pytest.raises(DatasetError, match="expected one of train"):
        data.indices("trian")


def test_unknown_ground_truth_is_absent(tmp_path):
    required = ("pitch_mm", "channels", "source", "background", "frames", "split")
    write(tmp_path / "d.h5", **{key: content()[key] for key in required})
    data = read(tmp_path / "d.h5")
    for key in ("normals", "depth_mm", "valid", "force_n", "indenter", "rest_depth_mm"):
        assert getattr(data, key) is None
    with h5py.File(tmp_path / "d.h5") as file:
        assert set(file) == {"background", "frames", "split"}


def test_nothing_is_left_of_a_write_that_fails(tmp_path, monkeypatch):
    def fail(*_args, **_keys):
        raise KeyboardInterrupt

    monkeypatch.setattr(h5py.File, "create_dataset", fail)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "d.h5", **content())
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_keeps_the_old_file(path):
    before = path.read_bytes()
    with pytest.raises(DatasetError, match="depth_mm"):
        write(path, **{**content(), "depth_mm": np.zeros((N, H, W + 1))})
    assert path.read_bytes() == before


def corrupt(path, key, value, dtype=None):
    with h5py.File(path, "r+") as file:
        if key in file.attrs:
            file.attrs[key] = value
        else:
            del file[key]
            if value is not None:
                file.create_dataset(key, data=value, dtype=dtype)


def spoiled(key, index, value):
    array = content()[key].astype(np.float32)
    array[index] = value
    return array


everywhere_valid = np.ones((N, H, W), bool)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("format_version", 2, "format_version = 2: expected 1"),
        ("channels", "R,G,B", "channels = R,G,B: expected B,G,R"),
        ("channels", 3, "channels = .*3.*: expected str"),
        ("pitch_mm", -1.0, "pitch_mm = -1.0: expected a positive"),
        ("pitch_mm", np.nan, "pitch_mm = nan: expected a positive"),
        ("frames", None, "frames: missing"),
        ("split", None, "split: missing"),
        ("frames", np.zeros((N, H, W, 4), np.uint16), "frames = uint16: expected uint8"),
        ("frames", np.zeros((N, H, W, 3), np.uint8), "frames = .*expected shape"),
        ("background", np.zeros((H, W + 1, 4), np.uint8), "background = .*expected shape"),
        ("split", ["train", "trian", "test"], "split = 'trian': expected one of train"),
        ("split", [0, 1, 2], "split = int64: expected text"),
        ("depth_mm", np.zeros((N, H, W)), "depth_mm = float64: expected float32"),
        ("depth_mm", spoiled("depth_mm", (1, 2, 3), np.nan), r"depth_mm\[1\] = NaN"),
        ("normals", spoiled("normals", (2, 0, 0, 1), np.nan), r"normals\[2\] = NaN"),
        ("normals", spoiled("normals", (0, 4, 4), (0, 0, 1.01)), r"normals\[0\] = a vector of length 1.01"),
        ("normals", spoiled("normals", (0, 4, 4), (0.6, 0.8, 0)), r"normals\[0\] = n_z 0: expected n_z > 0"),
        ("force_n", spoiled("force_n", (0, 0), np.inf), "force_n = NaN or infinite"),
        ("rest_depth_mm", spoiled("rest_depth_mm", (0, 0), np.nan), "rest_depth_mm = NaN or infinite"),
        ("indenter/ball_mm", np.zeros(N + 1), "indenter/ball_mm = .*expected 3 entries"),
    ],
)
def test_refuses_a_bad_file(path, key, value, message):
    corrupt(path, "valid", everywhere_valid)
    read(path)
    corrupt(path, key, value)
    with pytest.raises(DatasetError, match=message) as error:
        read(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_nothing_is_asked_of_ground_truth_that_is_not_valid(path):
    valid = everywhere_valid.copy()
    valid[1, 2, 3] = False
    corrupt(path, "valid", valid)
    corrupt(path, "normals", spoiled("normals", (1, 2, 3), np.nan))
    corrupt(path, "depth_mm", spoiled("depth_mm", (1, 2, 3), np.nan))
    assert np.isnan(read(path).normals[1, 2, 3]).all()


def test_refuses_unknown_and_missing_keys(path):
    with h5py.File(path, "r+") as file:
        file["normal"] = 1
    with pytest.raises(DatasetError, match="normal: unknown key"):
        read(path)
    with h5py.File(path, "r+") as file:
        del file["normal"]
        del file.attrs["pitch_mm"]
    with pytest.raises(DatasetError, match="pitch_mm: missing attribute"):
        read(path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"channels": "bgr"}, r"channels = B,G,R,NIR: expected B,G,R \(tiny\)"),
        ({"width_px": 32}, r"frames = 16 x 20 px: expected 16 x 32 px \(tiny\)"),
        ({"pitch_mm": 0.2506}, r"pitch_mm = 0.25: expected 0.2506 \(tiny\)"),
    ],
)
def test_refuses_frames_of_another_scene(path, changed, message):
    read(path, scene(pitch_mm=0.2502))
    with pytest.raises(DatasetError, match=message):
        read(path, scene(**changed))


def test_refuses_what_is_not_a_dataset(tmp_path, path):
    with pytest.raises(DatasetError, match="no such file"):
        read(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("frames")
    with pytest.raises(DatasetError, match="not an HDF5 file"):
        read(tmp_path / "text.h5")
    (tmp_path / "cut.h5").write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(DatasetError, match=r"cut\.h5"):
        read(tmp_path / "cut.h5")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("frames", np.zeros((N, H, W, 4)), "frames = float64: expected uint8"),
        ("channels", ("R", "G", "B", "NIR"), "channels = R,G,B,NIR"),
        ("split", np.array(["train"] * (N + 1)), "split = .*expected shape"),
    ],
)
def test_refuses_to_write_what_it_would_not_read(tmp_path, key, value, message):
    with pytest.raises(DatasetError, match=message):
        write(tmp_path / "d.h5", **{**content(), key: value})
    with pytest.raises(DatasetError, match="is not a folder"):
        write(tmp_path / "none" / "d.h5", **content())


class TestForceAxes:
    def of_z(self, **changed):
        return {**content(), "force_n": content()["force_n"][:, 2:], "force_axes": ("z",), **changed}

    def test_all_three_unless_the_file_says_so(self, path, tmp_path):
        data = read(path)
        assert data.force_axes == ("x", "y", "z")
        with h5py.File(path) as file:
            assert "force_axes" not in file.attrs
        np.testing.assert_array_equal(data.forces_n([0, 2], (0, 2)), data.force_n[[0, 2]][:, [0, 2]])
        write(tmp_path / "z.h5", **self.of_z())
        data = read(tmp_path / "z.h5")
        assert data.force_axes == ("z",)
        assert data.force_n.shape == (N, 1)

    def test_what_was_not_measured_cannot_be_read(self, tmp_path):
        write(tmp_path / "z.h5", **self.of_z())
        data = read(tmp_path / "z.h5")
        np.testing.assert_array_equal(data.forces_n([1], (2,)), data.force_n[[1]])
        assert data.has_force((2,))
        assert not data.has_force((0, 1, 2))
        with pytest.raises(DatasetError, match="force_n: y: not measured"):
            data.forces_n([1], (2, 1))

    @pytest.mark.parametrize(
        ("changed", "message"),
        [
            ({"force_axes": ("x", "z")}, r"force_n = \(3, 1\): expected shape \(3, 2\)"),
            ({"force_axes": ("w",)}, "force_axes = 'w': expected some of x, y, z, in this order"),
            ({"force_axes": ("z", "x")}, "force_axes = 'z,x': expected some of x, y, z, in this order"),
            ({"force_axes": ()}, "force_axes = '': expected some of x, y, z, in this order"),
        ],
    )
    def test_refuses_other_axes(self, tmp_path, changed, message):
        with pytest.raises(DatasetError, match=message):
            write(tmp_path / "z.h5", **self.of_z(**changed))


class TestGroups:
    def test_name_the_recording_of_each_frame(self, path, tmp_path):
        assert read(path).group is None
        write(tmp_path / "g.h5", **content(), group=np.array(["cup", "gröber Ball", "cup"]))
        np.testing.assert_array_equal(read(tmp_path / "g.h5").group, ["cup", "gröber Ball", "cup"])

    def test_refuses_other_groups(self, tmp_path):
        with pytest.raises(DatasetError, match=r"group = \(2,\): expected shape \(3,\)"):
            write(tmp_path / "g.h5", **content(), group=np.array(["a", "b"]))
        with pytest.raises(DatasetError, match="group = '': expected a name"):
            write(tmp_path / "g.h5", **content(), group=np.array(["a", "", "b"]))
        write(tmp_path / "g.h5", **content())
        with h5py.File(tmp_path / "g.h5", "a") as file:
            file["group"] = np.arange(N)
        with pytest.raises(DatasetError, match="group = int64: expected text"):
            read(tmp_path / "g.h5")


def raw_content():
    rng = np.random.default_rng(2)
    known = content()
    for key in ("frames", "background"):
        del known[key]
    raw = rng.integers(0, 1024, (N + 1, 4 * H, 4 * W), dtype=np.uint16)
    return known | {"raw10": raw[1:], "background": raw[0]}


def test_raw10_stands_in_for_frames(tmp_path):
    markers, moved = np.zeros((N, 5, 2)), np.ones((N, H, W, 2))
    write(tmp_path / "d.h5", **raw_content(), markers_px=markers, tangential_mm=moved, left_out=7)
    data = read(tmp_path / "d.h5", scene(frames="raw10"))
    assert len(data) == N
    assert data.frames is None
    np.testing.assert_array_equal(data.raw10, raw_content()["raw10"])
    assert (data.raw10.dtype, data.background.dtype) == (np.uint16, np.uint16)
    assert (data.markers_px.shape, data.tangential_mm.dtype) == ((N, 5, 2), np.float32)
    assert data.left_out == 7


def test_channels_stand_in_for_raw10_that_is_not_read(tmp_path, monkeypatch):
    path, known = tmp_path / "d.h5", raw_content()
    write(path, **known)
    shape = (len(known["raw10"]), *(side // 4 for side in known["background"].shape), 4)
    channels = {"frames": np.full(shape, 7, np.uint8), "background": np.full(shape[1:], 5, np.uint8)}
    whole, arrays, original = read(path), [], h5py.Dataset.__getitem__

    def noted(self, *arguments, **more):
        arrays.append(self.name)
        return original(self, *arguments, **more)

    with monkeypatch.context() as patch:
        patch.setattr(h5py.Dataset, "__getitem__", noted)
        data = read(path, instead_of_raw10=channels)
    assert "/normals" in arrays
    assert not {"/raw10", "/background"} & set(arrays)
    assert data.raw10 is None
    assert data.frames is channels["frames"]
    assert data.background is channels["background"]
    np.testing.assert_array_equal(data.normals, whole.normals)
    with pytest.raises(DatasetError, match=r"d.h5: split = .*: expected shape"):
        read(path, instead_of_raw10=channels | {"frames": channels["frames"][1:]})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frames": content()["frames"]}, "raw10 = beside frames: expected one of the two"),
        ({"raw10": raw_content()["raw10"].astype(np.uint8)}, "raw10 = uint8: expected uint16"),
        ({"background": content()["background"]}, "background = uint8: expected uint16"),
        ({"raw10": raw_content()["raw10"] + np.uint16(2)}, "raw10 = 102.: expected 10-bit values up to 1023"),
        ({"raw10": raw_content()["raw10"][:, :-1]}, "raw10 = .*: expected shape .*multiples of 4"),
        ({"raw10": raw_content()["raw10"][:, :-4]}, "background = .*expected shape"),
        ({"markers_px": np.zeros((N, 4))}, "markers_px = .*expected shape"),
        ({"markers_px": np.full((N, 4, 2), np.nan)}, "markers_px = NaN"),
        ({"tangential_mm": np.zeros((N, H, W))}, "tangential_mm = .*expected shape"),
    ],
)
def test_refuses_bad_raw10_and_markers(tmp_path, changes, message):
    with pytest.raises(DatasetError, match=message):
        write(tmp_path / "d.h5", **raw_content() | changes)
    assert list(tmp_path.iterdir()) == []
