import numpy as np
import pytest
from PIL import Image

from fastac.sensor import dataset
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.force_labels import split_by_group
from fastac.sensor.importers.force_recording import import_recordings

HEADER = "frame,force_z_n,group\n"
SIZE = {"height_px": 16, "width_px": 16}
N = 12


def rows(changes=(), header=HEADER):
    """Twelve labelled frames in groups a, b and c, the first two of each without contact; `changes` by
    row."""
    lines = [f"{k},{0 if k % 4 < 2 else k},{'abc'[k // 4]}" for k in range(N)]
    for k, line in dict(changes).items():
        lines[k] = line
    return header + "".join(f"{line}\n" for line in lines if line is not None)


@pytest.fixture
def place(tmp_path):
    """Photographs of 24 × 32 px: noise around a level that is 5 higher in every group."""
    rng = np.random.default_rng(1)
    (tmp_path / "frames").mkdir()
    images = rng.integers(80, 120, (N, 32, 24, 3), dtype=np.uint8)
    for k in range(N):
        images[k] += np.uint8(5 * (k // 4))
        Image.fromarray(images[k]).save(tmp_path / "frames" / f"{k}.png")
    (tmp_path / "f.csv").write_text(rows())
    return tmp_path


def imported(place, source="frames", **changed):
    arguments = {"background_frames": 2, "pitch_mm": 0.2, "progress": False, **SIZE, **changed}
    import_recordings([(place / source, place / "f.csv")], output=place / "d.h5", **arguments)
    return dataset.read(place / "d.h5")


def photographs(place):
    images = [np.asarray(Image.open(place / "frames" / f"{k}.png"), float)[..., ::-1] for k in range(N)]
    return np.stack(images)


def pooled(images):
    """Photographs (…, 32, 24, C) averaged over 2 × 2 px."""
    *outer, height, width, channels = images.shape
    return images.reshape(*outer, height // 2, 2, width // 2, 2, channels).mean(axis=(-4, -2))


def test_frames_are_resampled_onto_the_mean_of_the_first(place):
    data, images = imported(place), photographs(place)
    inside = (slice(None), slice(None), slice(2, 14))
    np.testing.assert_allclose(data.frames[inside], pooled(images), atol=0.5)
    np.testing.assert_allclose(data.background[:, 2:14], pooled(images[:2].mean(axis=0)), atol=0.5)
    padding = data.frames[:, :, [0, 1, 14, 15]]
    np.testing.assert_array_equal(padding, np.broadcast_to(data.background[:, [0, 1, 14, 15]], padding.shape))


def test_forces_groups_and_axes_are_those_of_the_file(place):
    data = imported(place)
    np.testing.assert_array_equal(data.force_n[:, 0], [0 if k % 4 < 2 else k for k in range(N)])
    assert data.force_axes == ("z",)
    assert "".join(data.group) == "aaaabbbbcccc"
    assert data.pitch_mm == 0.2
    assert data.channels == ("B", "G", "R")
    assert data.source == "recorded: forces from frames"
    assert data.normals is None
    text = "frame,group,force_z_n,force_y_n,force_x_n\n" + "".join(
        f"{k},{k % 2},{k},2,-1\n" for k in range(N)
    )
    (place / "f.csv").write_text(text.replace("0,0,0,2,-1", "0,0,0,0,0"))
    data = imported(place, background_frames=1)
    assert data.force_axes == ("x", "y", "z")
    np.testing.assert_array_equal(data.force_n[5], [-1, 2, 5])


def test_rows_may_come_in_any_order_and_by_file_name(place):
    expected = imported(place)
    header, *lines = rows().splitlines()
    named = [line.replace(",", ".png,", 1) for line in reversed(lines)]
    (place / "f.csv").write_text("\n".join([header, *named]))
    found = imported(place)
    for key in ("frames", "force_n", "group"):
        np.testing.assert_array_equal(getattr(found, key), getattr(expected, key))


def test_background_frames_may_lack_a_row(place):
    expected = imported(place)
    (place / "f.csv").write_text(rows({0: None, 1: None}))
    found = imported(place)
    np.testing.assert_array_equal(found.background, expected.background)
    np.testing.assert_array_equal(found.frames, expected.frames[2:])


def test_videos_are_folders_of_frames(place):
    from tests.sensor.importers.test_footage import film

    expected, images = imported(place), photographs(place).astype(np.uint8)
    film(place / "v.mkv", images)
    found = imported(place, "v.mkv")
    for key in ("frames", "background", "force_n", "split"):
        np.testing.assert_array_equal(getattr(found, key), getattr(expected, key))
    film(place / "v.mp4", np.repeat(np.repeat(images, 4, axis=1), 4, axis=2), codec="mpeg4")
    assert np.abs(imported(place, "v.mp4").frames.astype(int) - expected.frames).mean() < 10


def test_a_wrong_reading_of_the_gauge_does_not_turn_its_sign(place):
    (place / "f.csv").write_text(rows({5: "5,-12,b"}))
    assert imported(place, keep_pulls=True).force_n.min() == -12


class TestSeveralRecordings:
    def both(self, place, text=None, **changed):
        """The recording twice, the second a hundredth of the range brighter, with other groups."""
        other = place / "other"
        other.mkdir(exist_ok=True)
        for k, image in enumerate(photographs(place).astype(np.uint8)):
            Image.fromarray(image[..., ::-1] + np.uint8(3)).save(other / f"{k}.png")
        again = rows().replace(",a", ",d").replace(",c", ",e")
        (place / "g.csv").write_text(again if text is None else text)
        pairs = [(place / "frames", place / "f.csv"), (other, place / "g.csv")]
        arguments = {"background_frames": 2, "pitch_mm": 0.2, "progress": False, **SIZE, **changed}
        import_recordings(pairs, output=place / "both.h5", **arguments)
        return dataset.read(place / "both.h5")

    @pytest.mark.parametrize("per_group", [False, True])
    def test_each_has_backgrounds_of_its_own(self, place, per_group):
        """So that what is brighter from rest on looks as the other."""
        found, one = self.both(place, per_group=per_group), imported(place, per_group=per_group)
        change, expected = (data.frames.astype(int) - data.background for data in (found, one))
        for half in (slice(0, N), slice(N, None)):
            np.testing.assert_allclose(change[half], expected, atol=1)
        np.testing.assert_array_equal(found.force_n, np.tile(one.force_n, (2, 1)))

    def test_a_group_may_be_in_several(self, place):
        found = self.both(place)
        np.testing.assert_array_equal(found.group, [*"aaaabbbbcccc", *"ddddbbbbeeee"])
        np.testing.assert_array_equal(found.split == "test", found.group == "e")
        found = self.both(place, held_out=("b",))
        np.testing.assert_array_equal(found.split == "test", found.group == "b")

    def test_what_does_not_fit_together_is_refused(self, place):
        header, *lines = rows().splitlines()
        own = "".join(f"{line}\n" for line in [f"{header},split", *(f"{line},train" for line in lines)])
        with pytest.raises(ImportFailure, match=r"f.csv: split: missing column, which .*g.csv has"):
            self.both(place, own)
        sideways = header.replace("force_z_n", "force_x_n,force_y_n,force_z_n")
        of_three = [sideways, *(line.replace(",", ",0,0,", 1) for line in lines)]
        with pytest.raises(ImportFailure, match=r"g.csv: forces: expected force_z_n, as .*f.csv has"):
            self.both(place, "".join(f"{line}\n" for line in of_three))
        with pytest.raises(ImportFailure, match=r"f.csv, .*g.csv: group 'x': expected one of a, b, c, d, e"):
            self.both(place, held_out=("x",))
        pair = (place / "frames", place / "f.csv")
        with pytest.raises(ImportFailure, match=r"f.csv: named twice"):
            import_recordings([pair, pair], background_frames=2, pitch_mm=0.2, output=place / "d.h5")


class TestPulls:
    """Nothing pulls a skin: a gauge that is pulled reads what the skin does not feel."""

    def test_frames_are_left_out_and_counted(self, place):
        expected = imported(place)
        (place / "f.csv").write_text(rows({4: "4,-3,b", 5: "5,-0.56,b", 8: "8,-0.54,c"}))
        found, kept = imported(place), np.delete(np.arange(len(expected)), [4, 5])
        np.testing.assert_array_equal(found.frames, expected.frames[kept])
        for key in ("group", "split"):
            np.testing.assert_array_equal(getattr(found, key), getattr(expected, key)[kept])
        assert found.force_n.min() == np.float32(-0.54)  # less than a twentieth of 11 N
        assert found.left_out == expected.left_out + 2

    def test_they_can_be_kept(self, place):
        (place / "f.csv").write_text(rows({4: "4,-3,b"}))
        found = imported(place, keep_pulls=True)
        assert (found.force_n.min(), len(found)) == (-3, N)


class TestSplit:
    def test_the_last_group_is_the_test(self, place):
        assert set(imported(place).split[8:]) == {"test"}
        assert "test" not in imported(place).split[:8]

    def test_groups_are_held_out_by_name(self, place):
        data = imported(place, held_out=("a", "c"))
        np.testing.assert_array_equal(data.split == "test", np.isin(data.group, ["a", "c"]))

    def test_a_fifth_of_each_other_group_is_the_validation_in_stretches(self):
        group = np.repeat(["x", "y", "z"], [100, 50, 40])
        split = split_by_group(group, ("z",))
        for name, size in (("x", 20), ("y", 10)):
            chosen = np.flatnonzero((group == name) & (split == "validation"))
            assert len(chosen) == size
            assert (np.diff(chosen) > 1).sum() == 1
        assert set(split[group == "z"]) == {"test"}

    def test_the_file_may_say_it(self, place):
        split = ["train", "validation", "test"] * 4
        lines = rows().splitlines()
        text = "\n".join([lines[0] + ",split", *(f"{a},{b}" for a, b in zip(lines[1:], split, strict=True))])
        (place / "f.csv").write_text(text)
        np.testing.assert_array_equal(imported(place).split, split)
        with pytest.raises(ImportFailure, match="split: a column of its own"):
            imported(place, held_out=("a",))

    def test_something_is_held_out_and_something_left(self, place):
        with pytest.raises(ImportFailure, match="group 'd': expected one of a, b, c"):
            imported(place, held_out=("d",))
        with pytest.raises(ImportFailure, match="group: all 3 are held out"):
            imported(place, held_out=("a", "b", "c"))
        (place / "f.csv").write_text(rows().replace(",b", ",a").replace(",c", ",a"))
        with pytest.raises(ImportFailure, match="group = 'a' in every row: nothing can be held out"):
            imported(place)


class TestBackgroundPerGroup:
    def test_differences_are_from_the_group_s_own_rest(self, place):
        data, images = imported(place, per_group=True), pooled(photographs(place))
        inside = slice(2, 14)
        for g in range(3):
            own = slice(4 * g, 4 * g + 4)
            rest = images[4 * g : 4 * g + 2].mean(axis=0)
            difference = data.frames[own][:, :, inside].astype(float) - data.background[:, inside]
            np.testing.assert_allclose(difference, images[own] - rest, atol=1.0)

    def test_every_group_has_enough(self, place):
        (place / "f.csv").write_text(rows({11: "11,0,d"}))
        with pytest.raises(ImportFailure, match="group 'd' has 1 frames: expected 2 of background"):
            imported(place, per_group=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"f\.csv: frame: missing column"),
        (HEADER, r"f\.csv: frame: expected at least one row"),
        (rows(header="frame,force_z_n\n"), r"f\.csv: group: missing column"),
        (rows(header="frame,force_n,group\n"), r"'force_n': unknown column; did you mean force_z_n\?"),
        (rows(header="frame,force_x_n,group\n"), r"f\.csv: force_z_n: missing column"),
        (rows(header="frame,frame,group\n"), r"f\.csv: frame: column named twice"),
        (
            "frame,force_x_n,force_z_n,group\n0,0,0,a\n",
            r"f\.csv: force_y_n: missing column",
        ),
        (rows({3: "3,nan,a"}), r"f\.csv, line 5: force_z_n = 'nan': expected a number"),
        (rows({3: "3,1;5,a"}), r"f\.csv, line 5: force_z_n = '1;5': expected a number"),
        (rows({3: "3,,a"}), r"f\.csv, line 5: force_z_n: missing value"),
        (rows({3: "3,1"}), r"f\.csv, line 5: group: missing value"),
        (rows({3: "3,1,a,b"}), r"f\.csv, line 5: 4 values: expected 3"),
        (rows({3: "-3,1,a"}), r"f\.csv, line 5: frame = '-3': expected an index from 0 or a file in"),
        (rows({3: "x.png,1,a"}), r"f\.csv, line 5: frame = 'x\.png': expected an index from 0 or a file in"),
        (
            rows({3: "9" * 5000 + ",1,a"}),
            r"f\.csv, line 5: frame = '9+': expected an index from 0 or a file in",
        ),
        (rows({3: "2,1,a"}), r"f\.csv, line 5: frame = 2: named twice"),
        (rows({3: None}), r"f\.csv: frame 3: no row, though frame 11 has one"),
        (rows({11: None}), r"f\.csv: frame 11: no row, but .*frames has this frame"),
        (rows() + "12,1,c\n", r"f\.csv, line 14: frame = 12: .*frames has 12 frames"),
        (rows({1: "1,2,a"}), "line 3: 2 N in background frame 1: expected at most 10% of the largest force"),
        (rows().replace(",1", ",-1"), r"force_z_n = -11 to 7, mostly negative"),
    ],
)
def test_refuses_bad_labels(place, text, message):
    (place / "f.csv").write_text(text)
    with pytest.raises(ImportFailure, match=message) as error:
        imported(place)
    assert "\n" not in str(error.value)
    assert not (place / "d.h5").exists()


def test_refuses_bad_split(place):
    (place / "f.csv").write_text("frame,force_z_n,group,split\n0,0,a,dev\n")
    with pytest.raises(ImportFailure, match="line 2: split = 'dev': expected one of train, validation, test"):
        imported(place)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"pitch_mm": 0.0}, "pitch_mm = 0: expected more than 0"),
        ({"background_frames": 0}, "background_frames = 0: expected 1 to 12"),
        ({"background_frames": 13}, "background_frames = 13: expected 1 to 12"),
    ],
)
def test_refuses_impossible_settings(place, changed, message):
    with pytest.raises(ImportFailure, match=message):
        imported(place, **changed)


def test_refuses_photographs_of_two_sizes(place):
    Image.new("RGB", (32, 24)).save(place / "frames" / "7.png")
    with pytest.raises(ImportFailure, match="frame 7 = 32 x 24 px: expected the first frame's 24 x 32"):
        imported(place)
    (place / "f.csv").unlink()
    with pytest.raises(ImportFailure, match=r"f\.csv: no such file"):
        imported(place)


def test_forces_of_the_other_sign(place):
    (place / "f.csv").write_text(rows())
    expected = imported(place)
    lines = [line.split(",") for line in rows(header="").splitlines()]
    turned = "".join(f"{frame},{-float(force_n)},{group}\n" for frame, force_n, group in lines)
    (place / "f.csv").write_text(HEADER + turned)
    with pytest.raises(ImportFailure, match=r"expected positive values in compression \(--negate"):
        imported(place)
    np.testing.assert_array_equal(imported(place, negate=True).force_n, expected.force_n)
