"""What frames tell of slip: spreads of skins that are made up, and the frames of drags."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.sensor.geometry import rest_depth_mm
from fastac.sensor.mechanics.indenter import Ball
from fastac.sensor.mechanics.press import ContactError, PressedSkin
from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.optics.marker_grid import marker_centres_mm
from fastac.studies.slip.drags import SHARES, drags
from fastac.studies.slip.measurement import WANTED, record, true_spread


def skin(sensor, tangential_mm, displaced_mm):
    return PressedSkin(
        np.zeros((*displaced_mm.shape, 3)),
        rest_depth_mm(sensor) - displaced_mm,
        displaced_mm > 0,
        np.zeros(3),
        {},
        tangential_mm,
    )


def test_a_rigid_motion_has_no_spread_and_a_stretch_has(slip_bundle):
    scene, sensor = slip_bundle.scene, slip_bundle.scene.sensor
    height, width = sensor.height_px, sensor.width_px
    y, x = (
        np.mgrid[:height, :width] - np.array([height - 1, width - 1]).reshape(2, 1, 1) / 2
    ) * sensor.pitch_mm
    everywhere = np.full((height, width), 2 * scene.slip.contact_mm)
    turned = np.stack([0.1 - 0.01 * y, 0.2 + 0.01 * x], axis=-1)
    spread, dots = true_spread(scene, skin(sensor, turned, everywhere))
    assert dots == len(marker_centres_mm(sensor))
    assert spread == pytest.approx(0, abs=1e-9)
    stretched = np.stack([0.05 * x, np.zeros_like(x)], axis=-1)
    spread, _ = true_spread(scene, skin(sensor, stretched, everywhere))
    x_px, y_px = (marker_centres_mm(sensor) / sensor.pitch_mm).T
    expected = 0.05 * np.sqrt((x_px**2).mean())  # on a centred grid a stretch holds no rotation
    assert (x_px * y_px).sum() == pytest.approx(0)
    assert spread == pytest.approx(expected)


def test_only_touching_dots_count(slip_bundle):
    scene, sensor = slip_bundle.scene, slip_bundle.scene.sensor
    displaced = np.full((sensor.height_px, sensor.width_px), 0.5 * scene.slip.contact_mm)
    assert true_spread(scene, skin(sensor, np.zeros((*displaced.shape, 2)), displaced)) == (0, 0)


def test_frames_go_through_the_integers(slip_bundle, tiny_rig_cache, monkeypatch):
    from fastac.studies.slip import measurement

    rig, seen = rig_of(slip_bundle.scene.sensor, tiny_rig_cache, progress=False), []

    class Emulator(measurement.Emulator):
        def run(self, frames, **settings):
            seen.append(super().run(frames, **settings))
            return seen[-1]

    monkeypatch.setattr(measurement, "Emulator", Emulator)
    drag = drags(slip_bundle.scene, {"ball": Ball(8.0)})[1]
    none = replace(drag, x_mm=50.0)
    one, error = record(slip_bundle, rig, [drag, none], progress=False)
    assert isinstance(error, ContactError)
    [found] = seen
    assert set(WANTED) <= {name for name, value in vars(found).items() if value is not None}
    np.testing.assert_array_equal(one.slip_px, found.slip_px)
    np.testing.assert_array_equal(one.slip_dots, found.slip_dots)
    np.testing.assert_array_equal(one.found_force_n, found.force_n)
    assert {len(values) for name, values in vars(one).items() if name != "drag"} == {len(SHARES)}
    np.testing.assert_array_equal(one.slips, one.sticking < 0.5)
    np.testing.assert_array_equal(one.known, (one.slip_dots >= 3) & (one.true_slip_dots >= 3))
    assert one.known.any()
