import numpy as np
import pytest

from fastac.scenes.sensor_schema import Light, Sensor
from fastac.sensor.geometry import normals_from_slopes
from fastac.sensor.optics.light import irradiance
from fastac.sensor.optics.sources import source_mm

FLAT = Sensor(geometry="flat", height_px=32, width_px=32, pitch_mm=0.5, channels="bgr+nir")
B, G, R, NIR = range(4)


def lit(p, q, sensor=FLAT, depth_mm=0.0):
    shape = sensor.height_px, sensor.width_px
    normals = normals_from_slopes(np.full(shape, p), np.full(shape, q))
    return irradiance(normals, np.full(shape, depth_mm), sensor)


def test_red_and_green_shine_perpendicular_to_blue_and_nir():
    b, g, r, nir = (source_mm(channel, Light())[:2] for channel in ("B", "G", "R", "NIR"))
    np.testing.assert_allclose(r, -g)
    np.testing.assert_allclose(b, -nir)
    assert (r - g) @ (b - nir) == pytest.approx(0)
    assert source_mm("R", Light())[2] < 0, "inside the finger"


@pytest.mark.parametrize(
    ("p", "q", "brighter", "darker"),
    [(0.2, 0.2, R, G), (-0.2, -0.2, G, R), (-0.2, 0.2, B, NIR), (0.2, -0.2, NIR, B)],
)
def test_a_skin_that_rises_towards_a_source_faces_it(p, q, brighter, darker):
    change = (lit(p, q) - lit(0, 0)).mean(axis=(0, 1))
    assert change[brighter] > 0 > change[darker]


def test_lambert_and_inverse_square():
    light = Light(ambient=0, softening_mm=0, distance_mm=10, below_mm=10)
    sensor = FLAT.model_copy(update={"light": light})
    source = source_mm("R", light)
    v, u = 3, 20
    skin = np.array([(u - 15.5) * 0.5, (v - 15.5) * 0.5, 1.0])
    to_source = source - skin
    distance = np.linalg.norm(to_source)
    inwards = -normals_from_slopes(np.array(0.3), np.array(-0.1))
    want = (to_source @ inwards) / distance**3 * 200
    assert lit(0.3, -0.1, sensor, 1.0)[v, u, R] == pytest.approx(want)


def test_a_slope_turned_away_gets_the_diffuse_share_only():
    np.testing.assert_allclose(lit(-20.0, -20.0)[..., R], Light().ambient)
    assert lit(-20.0, -20.0)[..., G].min() > Light().ambient


def test_a_mirror_s_lobe_points_half_way_between_source_and_camera():
    light = Light(ambient=0, specular=0.5, shininess=60, softening_mm=0)
    sensor = FLAT.model_copy(update={"light": light})
    plain = FLAT.model_copy(update={"light": light.model_copy(update={"specular": 0.0})})
    v, u = 15, 15
    skin = np.array([(u - 15.5) * 0.5, (v - 15.5) * 0.5, 0.0])
    to_source = source_mm("R", light) - skin
    half = to_source / np.linalg.norm(to_source) + [0, 0, -1]
    p, q = -half[:2] / half[2]  # the skin whose lit side, −n, looks that way
    share = lit(p, q, sensor)[v, u, R] / lit(p, q, plain)[v, u, R]
    cosine = -(to_source @ normals_from_slopes(np.array(p), np.array(q))) / np.linalg.norm(to_source)
    assert share == pytest.approx(0.5 + 0.5 / cosine)
    level = lit(0, 0, sensor)[v, u, R] / lit(0, 0, plain)[v, u, R]
    assert level == pytest.approx(0.5, abs=0.01), "only the diffuse half is left beside the lobe"
