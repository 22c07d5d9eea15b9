"""Cast shadows: none on a convex skin, and shadow edges at the positions that follow from geometry."""

import numpy as np
import pytest

from fastac.scenes.sensor_schema import Light, Sensor
from fastac.sensor.geometry import rest_depth_mm
from fastac.sensor.optics.light import irradiance
from fastac.sensor.optics.shadow import visible
from fastac.sensor.optics.sources import source_mm

SHARP = Light(distance_mm=30.0, below_mm=6.0, softening_mm=0.0, cast_shadows=True)
FLAT = Sensor(geometry="flat", height_px=64, width_px=64, pitch_mm=0.25, light=SHARP)


@pytest.mark.parametrize("channel", ["B", "G", "R", "NIR"])
def test_flat_skin_and_skin_at_rest_hide_nothing(channel):
    assert (visible(np.zeros((64, 64)), FLAT, channel) == 1).all()
    fingertip = Sensor(geometry="fingertip", light=Light(cast_shadows=True))
    assert visible(rest_depth_mm(fingertip), fingertip, channel).min() > 0.7


def test_a_step_s_shadow_ends_where_rays_pass_under_its_edge():
    """A step 2 mm deep along v, lit by R at (+, +), casts its shadow towards smaller u, where t < 2/6."""
    depth = np.zeros((64, 64))
    depth[:, 40:] = -2.0
    seen = visible(depth, FLAT, "R")
    source, v = source_mm("R", SHARP), 10
    x = (np.arange(64) - 31.5) * 0.25
    edge = x[40] - 0.125
    fraction = (edge - x[:40]) / (source[0] - x[:40])
    assert (seen[v, :38][fraction[:38] < 0.25] == 0).all()
    assert (seen[v, :38][fraction[:38] > 0.4] > 0.9).all()
    assert (seen[:, 40:] == 1).all()


def test_a_step_hides_its_foot_and_a_wide_glow_softens_the_edge():
    depth = np.zeros((64, 64))
    depth[:, 40:] = -2.0
    sharp = visible(depth, FLAT, "R")[32, :40]
    soft_light = SHARP.model_copy(update={"softening_mm": 3.0})
    soft = visible(depth, FLAT.model_copy(update={"light": soft_light}), "R")[32, :40]
    assert sharp[20:38].max() == 0
    assert sharp[:3].min() > 0.7
    assert soft[:5].mean() < sharp[:5].mean(), "half of a wide glow is hidden before its centre is"
    assert soft[6:19].min() > sharp[6:19].max(), "and half of it shows after that"


def test_irradiance_loses_the_hidden_sources_only():
    depth = np.zeros((64, 64))
    depth[:, 40:] = -2.0
    normals = np.zeros((64, 64, 3))
    normals[..., 2] = 1
    without = FLAT.model_copy(update={"light": SHARP.model_copy(update={"cast_shadows": False})})
    share = irradiance(normals, depth, FLAT) / irradiance(normals, depth, without)
    b, g, r, nir = share[32, 34]
    assert max(r, nir) < 0.9, "the sources on the step's side"
    assert b == g == 1
