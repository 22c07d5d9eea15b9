"""Colours, the surface and the arrow."""

import numpy as np
import pytest

from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord
from fastac.streaming.views import pictures
from fastac.streaming.views.pictures import RAMP, Sight


def about(**changes) -> About:
    known = {
        "scene": "s",
        "bundle_sha256": "0" * 64,
        "height_px": 10,
        "width_px": 12,
        "channels": ("B", "G", "R"),
        "pitch_mm": 0.5,
        "depth_origin_px": (1, 1),
        "force_axes": ("x", "y", "z"),
        "arrays": ("depth_mm",),
        "validity": (),
        "via": "emulator",
        "simulated_clock": True,
        "clock_mhz": 100.0,
        "source": "data.h5",
        "frames_per_second": 100.0,
    }
    return About(**known | changes)


def pressed(row: int, column: int, mm: float) -> tuple[Sight, StreamRecord]:
    rest = np.full((8, 10), 2.0, np.float32)
    depth = rest.copy()
    depth[row, column] -= mm
    record = StreamRecord(0, 0, force_n={"x": 0.3, "y": 0.0, "z": 0.4}, arrays={"depth_mm": depth})
    return Sight(about(), rest), record


def test_thinned_has_at_most_so_many_rows_and_columns():
    image = np.arange(126 * 100).reshape(126, 100)
    thin = pictures.thinned(image, 64)
    np.testing.assert_array_equal(thin, image[::2, ::2])
    assert pictures.thinned(image, 126).shape == image.shape
    assert pictures.thinned(image, 125).shape == (63, 50)


def test_colours_of_normals():
    found = pictures.colours_of_normals(np.array([[0, 0, 1.0], [-1, 1, 0]]))
    assert found.tolist() == [[128, 128, 255], [0, 255, 128]]


def test_colours_of_a_press_run_along_the_ramp():
    found = pictures.colours_of_press(np.array([-1.0, 0.0, 0.5, 2.0]), 0.5)
    assert found[:2].tolist() == [RAMP[0].tolist()] * 2
    assert found[2:].tolist() == [RAMP[-1].tolist()] * 2
    between = pictures.colours_of_press(np.array([0.25]), 0.5)[0].astype(int)
    np.testing.assert_allclose(between, RAMP[len(RAMP) // 2], atol=2)


def test_the_arrow_ends_where_the_skin_is_pressed():
    sight, record = pressed(2, 7, 0.6)
    press = sight.press_mm(record)
    sight.see(record, press)
    assert sight.full_press_mm == pytest.approx(0.6)
    assert (sight.full_force_n, sight.full_shear_n) == pytest.approx((0.5, 0.3))
    arrow = sight.arrow(record, press)
    np.testing.assert_allclose(arrow.tip_mm, [(7 - 4.5) * 0.5, (2 - 3.5) * 0.5, 1.4], rtol=1e-6)
    assert np.linalg.norm(arrow.vector_mm) == pytest.approx(pictures.ARROW_SHARE * 12 * 0.5)
    np.testing.assert_allclose(arrow.vector_mm / arrow.vector_mm[0], [1, 0, -4 / 3])  # into the skin


def test_scales_never_shrink():
    sight, record = pressed(2, 7, 0.6)
    sight.see(record, sight.press_mm(record))
    _, weak = pressed(2, 7, 0.1)
    sight.see(weak, sight.press_mm(weak))
    assert sight.full_press_mm == pytest.approx(0.6)


def test_without_depth_the_arrow_ends_at_the_centre_and_without_force_there_is_none():
    sight, _ = pressed(2, 7, 0.6)
    alone = StreamRecord(0, 0, force_n={"z": 1.0})
    sight.see(alone, sight.press_mm(alone))
    arrow = sight.arrow(alone, None)
    np.testing.assert_allclose(arrow.tip_mm, [0.25, 0.25, 2.0])
    assert arrow.vector_mm[:2].tolist() == [0, 0]
    assert arrow.vector_mm[2] < 0
    assert sight.arrow(StreamRecord(0, 0), None) is None


def test_triangles_cover_a_grid_and_look_up():
    rows, columns = 3, 4
    v, u = np.divmod(np.arange(rows * columns), columns)
    places = np.stack([u, v], 1).astype(float)
    a, b, c = (places[pictures.triangles(rows, columns)[:, k]] for k in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert area.tolist() == [0.5] * 12


def test_normals_of_a_slope():
    z = 0.5 * np.arange(5) * 0.1 + np.zeros((4, 1))  # rises by 0.5 along x, samples 0.1 mm apart
    expected = np.array([-0.5, 0, 1]) / np.hypot(0.5, 1)
    np.testing.assert_allclose(
        pictures.surface_normals(z, 0.1), np.broadcast_to(expected, (4, 5, 3)), atol=1e-6
    )


def test_the_rest_is_what_the_bundle_finds_when_nothing_touches(tiny_bundle):
    from fastac.models.emulator.pipeline import Emulator

    found = Emulator(tiny_bundle.pipeline).run(tiny_bundle.pipeline.background[None])
    np.testing.assert_allclose(pictures.rest_depth_mm(tiny_bundle), found.depth_mm[0, 1:-1, 1:-1], atol=1e-6)
