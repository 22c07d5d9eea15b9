from pathlib import Path

import cv2
import numpy as np
import pytest

from fastac.models.vision.markers import DetectedDots, Detector, MarkerError, Tracker, associate

PHOTOGRAPHS = Path(__file__).parents[4] / "shared/data/fots/markers"
needs_photographs = pytest.mark.skipif(
    not PHOTOGRAPHS.is_dir(), reason=f"the dotted gel's photographs are not in {PHOTOGRAPHS}"
)
GRID = np.stack(np.meshgrid(np.arange(15, 160, 16.0), np.arange(15, 110, 16.0)), axis=-1).reshape(-1, 2)


def picture(centres, *, diameter=6.0, seed=0, size=(120, 170)):
    """A noisy, unevenly lit skin with dark discs, drawn with smooth edges."""
    v, u = np.indices(size)
    skin = 90 + 100 * u / size[1] + 30 * np.sin(v / 25)
    for x, y in centres:
        cover = np.clip(diameter / 2 - np.hypot(u - x, v - y) + 0.5, 0, 1)
        skin = skin * (1 - 0.85 * cover)
    noise = np.random.default_rng(seed).normal(0, 2, size)
    return np.clip(np.rint(skin + noise), 0, 255).astype(np.uint8)


def rows_of(file):
    return np.loadtxt(PHOTOGRAPHS / file, delimiter=",", skiprows=1)


def test_detects_every_dot_to_a_fraction_of_a_pixel():
    centres = GRID + np.random.default_rng(1).uniform(-2, 2, GRID.shape)
    found = Detector(6.0).detect(picture(centres))
    matched = associate(centres, found, 3)
    assert len(found) == len(centres)
    assert np.hypot(*(found[matched] - centres).T).max() < 0.15


def test_colour_images_are_averaged():
    grey = picture(GRID)
    colour = np.repeat(grey[..., None], 4, axis=2)
    np.testing.assert_allclose(Detector(6.0).detect(colour), Detector(6.0).detect(grey))


def test_a_skin_without_dots_has_none_and_cut_dots_are_left_out():
    assert Detector(6.0).detect(picture([])).shape == (0, 2)
    found = Detector(6.0).detect(picture([(1.0, 50.0), (80.0, 50.0), (168.5, 60.0)]))
    np.testing.assert_allclose(found, [(80, 50)], atol=0.15)


def test_specks_and_streaks_are_no_dots():
    image = picture([(40.0, 40.0)])
    image[80, 80] = 0
    image[100, 20:60] = 10
    assert len(Detector(6.0).detect(image)) == 1


def test_association_follows_smooth_motion_beyond_half_the_spacing():
    bump = np.exp(-((GRID - GRID.mean(axis=0)) ** 2).sum(axis=1) / 2 / 35**2)
    moved = GRID + bump[:, None] * (10.0, 2.0)
    shuffled = np.random.default_rng(0).permutation(len(GRID))
    matched = associate(GRID, moved[shuffled], 8)
    np.testing.assert_array_equal(shuffled[matched], np.arange(len(GRID)))


def test_lost_and_new_markers_are_flagged_and_found_again():
    tracker = Tracker(GRID, 6)
    stray = np.array([[70.0, 23.0]])
    first = tracker.update(np.concatenate([np.delete(GRID + 2.0, 7, axis=0), stray]))
    assert np.flatnonzero(first.lost).tolist() == [7]
    np.testing.assert_array_equal(first.new_px, stray)
    np.testing.assert_array_equal(np.delete(first.displacement_px, 7, axis=0), 2.0)
    np.testing.assert_array_equal(first.displacement_px[7], 0.0)
    second = tracker.update(GRID[::-1] + 4.0)
    assert not second.lost.any()
    assert not len(second.new_px)
    np.testing.assert_array_equal(second.displacement_px, 4.0)
    np.testing.assert_array_equal(first.displacement_px[7], 0.0)


class TestDetectedDots:
    """Of a sensor with dots of 6 px, 16 px apart."""

    @pytest.fixture
    def sensor(self, make_scene):
        markers = {"spacing_mm": 1.6, "radius_mm": 0.3}
        return make_scene(sensor={"geometry": "flat", "pitch_mm": 0.1, "markers": markers}).sensor

    @staticmethod
    def frame(centres, seed=0):
        return np.repeat(picture(centres, seed=seed)[..., None], 4, axis=2)

    def test_shifts_are_from_where_the_background_shows_them(self, sensor):
        found = DetectedDots.of_background(self.frame(GRID), sensor)
        assert found.detector.diameter_px == pytest.approx(6)
        assert found.max_step_px == pytest.approx(16)
        matched = associate(GRID, found.rest_px, 3)
        bump = np.exp(-((GRID - GRID.mean(axis=0)) ** 2).sum(axis=1) / 2 / 35**2)
        moved = bump[:, None] * (3.0, -5.0)
        shift, seen = found.shifts_px(self.frame(GRID + moved, seed=1))
        assert seen.all()
        assert np.abs(shift[matched] - moved).max() < 0.2

    def test_lost_dots_have_no_shift_and_frames_do_not_depend_on_each_other(self, sensor):
        found = DetectedDots.at(GRID, sensor)
        np.testing.assert_array_equal(found.rest_px, GRID)
        frame = self.frame(np.delete(GRID + np.array((2.0, 1.0)), 7, axis=0))
        first, seen = found.shifts_px(frame)
        assert np.flatnonzero(~seen).tolist() == [7]
        assert not first[7].any()
        assert np.abs(first[seen] - (2, 1)).max() < 0.2
        shift, none = found.shifts_px(np.full_like(frame, 128))
        assert not none.any()
        assert not shift.any()
        again, _ = found.shifts_px(frame)
        np.testing.assert_array_equal(again, first)

    def test_refused(self, sensor, tiny_scene):
        with pytest.raises(MarkerError, match=r"^sensor\.markers: missing, so there are no dots to follow$"):
            DetectedDots.of_background(self.frame(GRID), tiny_scene.sensor)
        with pytest.raises(MarkerError, match=r"^background: no dot found$"):
            DetectedDots.of_background(self.frame([]), sensor)


def test_refuses_bad_input():
    with pytest.raises(MarkerError, match="all 60 lost; 1 dots found"):
        Tracker(GRID, 6).update(np.array([[500.0, 500.0]]))
    with pytest.raises(MarkerError, match="all 60 lost; 0 dots found"):
        Tracker(GRID, 6).update(np.empty((0, 2)))
    with pytest.raises(MarkerError, match="markers of the reference"):
        Tracker(np.empty((0, 2)), 6)
    with pytest.raises(MarkerError, match="max_step_px"):
        Tracker(GRID, 0)
    with pytest.raises(MarkerError, match="image: float64"):
        Detector(6.0).detect(np.zeros((20, 20)))
    with pytest.raises(MarkerError, match="diameter_px"):
        Detector(1.0)
    with pytest.raises(MarkerError, match="contrast"):
        Detector(6.0, contrast=1.0)


@needs_photographs
@pytest.mark.parametrize("index", range(6))
def test_dots_on_a_real_gel(index):
    """Positions and displacements agree with those tracked by the images' authors, given in whole pixels."""
    table = rows_of(f"{index}.csv")
    rest, displacement = table[:, :2], table[:, 2:]
    found = Detector(11.0).detect(cv2.imread(str(PHOTOGRAPHS / f"{index}.png")))
    matched = associate(rest + displacement, found, 10)
    seen = matched >= 0
    # Dots that the image's edge cuts are in the table, and not detected.
    assert seen[(rest + displacement < (310, 228)).all(axis=1)].all()
    error = np.hypot(*(found[matched[seen]] - rest[seen] - displacement[seen]).T)
    assert np.median(error) <= 1
    tracked = Tracker(rest, 14).update(found)
    assert tracked.lost.sum() == (~seen).sum()
    off = np.hypot(*(tracked.displacement_px - displacement)[~tracked.lost].T)
    assert np.median(off) <= 1


@needs_photographs
def test_motion_between_two_real_frames():
    tables = [rows_of(f"{i}.csv") for i in (0, 1)]
    found = [Detector(11.0).detect(cv2.imread(str(PHOTOGRAPHS / f"{i}.png"))) for i in (0, 1)]
    tracked = Tracker(found[0], 12).update(found[1])
    matched = associate(tables[0][:, :2] + tables[0][:, 2:], found[0], 10)
    both = (matched >= 0) & ~tracked.lost[matched]
    assert both.sum() >= 80
    want = (tables[1] - tables[0])[both, 2:]
    assert np.abs(want).max() == 12, "the frames differ by up to 12 px"
    off = tracked.displacement_px[matched[both]] - want
    assert np.median(np.hypot(*off.T)) <= 1
