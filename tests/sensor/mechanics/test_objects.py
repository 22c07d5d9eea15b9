"""The test objects have their characteristic features, and the pressed skin takes their shape."""

import numpy as np
import pytest
from scipy.ndimage import label, maximum_filter

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.mechanics.indenter import Ball, HeightMap
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.object_press import press_object
from fastac.sensor.mechanics.objects import OBJECTS, PITCH_MM, fingerprint, led_pads, strawberry
from fastac.sensor.mechanics.press import ContactError

SENSOR = Sensor(geometry="fingertip", height_px=64, width_px=64, pitch_mm=0.25)


@pytest.fixture(scope="module")
def layer():
    return Layer(SENSOR)


def test_a_strawberry_has_a_pit_with_a_seed_every_few_millimetres():
    height = strawberry(size_mm=10.0).height_mm
    x = (np.arange(len(height)) - (len(height) - 1) / 2) * PITCH_MM
    bumps = height - x**2 / 28 - x[:, None] ** 2 / 40
    assert bumps.max() == pytest.approx(0.35 * 0.75, abs=0.06)
    deep = label(bumps > 0.1)[1]
    assert 14 <= deep <= 26  # 10 x 10 mm over 2.4 x 2.08 mm
    middle = len(height) // 2
    assert bumps[middle, middle] < bumps[middle, middle + 6], "a seed stands in the pit"


def test_a_fingerprint_has_ridges_of_its_period():
    height = fingerprint(size_mm=12.0, period_mm=0.8, ridge_mm=0.1).height_mm
    x = (np.arange(len(height)) - (len(height) - 1) / 2) * PITCH_MM
    ridges = height - x**2 / 24 - x[:, None] ** 2 / 36
    assert np.ptp(ridges) == pytest.approx(0.1, rel=0.01)
    through_core = ridges[np.abs(x + 1.5).argmin(), x > 0.2]
    peaks = np.flatnonzero((maximum_filter(through_core, 5) == through_core) & (through_core > 0.05))
    np.testing.assert_allclose(np.diff(peaks) * PITCH_MM, 0.8, atol=0.051)
    assert len(peaks) >= 6


def test_pads_are_square_and_stand_out():
    height = led_pads(size_mm=9.0, spacing_mm=1.8, pad_mm=0.9, height_mm=0.25).height_mm
    pads, count = label(height < 0.125)
    assert count == 25
    middle = pads == pads[len(height) // 2, len(height) // 2]
    assert middle.sum() * PITCH_MM**2 == pytest.approx(0.81, rel=0.15)
    assert np.ptp(height) == pytest.approx(0.25, rel=0.01)


def test_a_ball_s_height_map_is_pressed_as_the_ball(layer):
    x, y = np.meshgrid(*2 * [np.linspace(-2.4, 2.4, 97)])
    surface = np.minimum(Ball(5.0).surface(x, y)[0], 2.5)
    own = layer.press(0.0, 0.0, ball_mm=5.0, load_n=1.0)
    found = press_object(layer, HeightMap(surface, 0.05), "ball", 1.0)
    np.testing.assert_allclose(found.pressed.depth_mm, layer.rest_depth_mm - own.displacement_mm, atol=2e-3)
    assert found.pressed.pose["approach_mm"] == pytest.approx(own.approach_mm, rel=1e-3)


@pytest.mark.parametrize("name", OBJECTS)
def test_the_skin_takes_the_object_s_shape_and_force(layer, name):
    found = press_object(layer, OBJECTS[name](), name, 4.0)
    pressed = found.pressed
    assert pressed.force_n[2] == pytest.approx(4.0)
    np.testing.assert_allclose(found.force_map_n.sum(axis=(0, 1)), pressed.force_n)
    np.testing.assert_array_equal(found.force_map_n[~pressed.in_contact], 0)
    q, p = np.gradient(pressed.depth_mm, SENSOR.pitch_mm)
    slopes = -pressed.normals[..., :2] / pressed.normals[..., 2:]
    assert np.abs(slopes - np.stack([p, q], -1))[1:-1, 1:-1].mean() < 0.04
    patches = label(pressed.in_contact)[1]
    assert patches >= (9 if name == "led_pads" else 1)


def test_refuses_a_load_that_is_too_much(layer):
    with pytest.raises(ContactError, match="led_pads with 400 N"):
        press_object(layer, led_pads(), "led_pads", 400.0)
    with pytest.raises(ContactError, match="nothing: expected inside the image"):
        layer.press_surface(np.full((64, 64), np.inf), load_n=1.0, what="nothing")
