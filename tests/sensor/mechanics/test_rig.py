"""`probe_of` on both contact models: the elastic layer and the finite-element gel."""

import numpy as np
import pytest

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.mechanics.rig import probe_of, rig_of
from fastac.sensor.protocol import Station

SIZE = {"geometry": "fingertip", "height_px": 16, "width_px": 16, "pitch_mm": 1.0}


@pytest.mark.parametrize(
    "gel", [{"mechanics": "layer"}, {"mechanics": "fem", "friction": 0.5, "elements": 12, "layers": 2}]
)
def test_a_ball_is_led_from_load_to_load(gel, tmp_path):
    rig = rig_of(Sensor(**SIZE, elastomer=gel), tmp_path, progress=False)
    probe = probe_of(rig, 5.0, 0.0, 0.0)
    approach = []
    for load_n in (0.5, 1.0, 0.5):
        pressed = probe.at_load(load_n)
        assert pressed.force_n[2] == pytest.approx(load_n)
        approach.append(pressed.pose["approach_mm"])
    assert approach[1] > approach[0]
    assert approach[2] == pytest.approx(approach[0], rel=0.05)
    once = rig.presses(Station("test", 0.0, 0.0, 0.5, 5.0))[0]
    again = probe_of(rig, 5.0, 0.0, 0.0).at_load(0.5)
    np.testing.assert_array_equal(again.normals, once.normals)
    with pytest.raises(ContactError):
        probe.at_load(1e3)
