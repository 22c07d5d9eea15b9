import numpy as np
import pytest

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import pixel_centres_mm
from fastac.sensor.mechanics.fem.gel import Gel
from fastac.sensor.mechanics.indenter import Ball, Cylinder, Edge, FlatPunch, HeightMap
from fastac.sensor.mechanics.press import ContactError

FLAT = Sensor(geometry="flat", height_px=64, width_px=64, pitch_mm=0.25)
CURVED = FLAT.model_copy(update={"geometry": "fingertip"})


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    return Gel.of_sensor(FLAT, tmp_path_factory.mktemp("cache"), elements=16, layers=3, progress=False)


@pytest.fixture(scope="module")
def curved(tmp_path_factory):
    return Gel.of_sensor(CURVED, tmp_path_factory.mktemp("cache"), elements=16, layers=3, progress=False)


@pytest.mark.parametrize(
    "indenter",
    [
        Ball(5.0),
        Cylinder(4.0, 5.0, 20.0),
        Edge(4.0),
        FlatPunch(3.0),
        HeightMap(np.outer(*2 * [np.hanning(20)]), 0.2),
    ],
    ids=lambda i: type(i).__name__,
)
@pytest.mark.parametrize("friction", [0.0, 0.8])
def test_every_indenter_reaches_its_load(curved, indenter, friction):
    contact = curved.press(indenter, 0.5, 1.0, load_n=1.0, friction=friction)
    assert contact.force_n[2] == pytest.approx(1.0)
    assert contact.in_contact.sum() >= 4
    assert contact.displacement_mm[..., 2].min() < -0.1
    assert np.isfinite(contact.displacement_mm).all()
    np.testing.assert_array_equal(contact.displacement_mm[[0, -1]], 0)
    np.testing.assert_array_equal(contact.displacement_mm[:, [0, -1]], 0)
    assert contact.sticking.any() == (friction > 0)


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1)])
@pytest.mark.parametrize("share", [0.3, 0.6])
def test_the_paper_s_tangential_loads(curved, direction, share):
    load = 0.5
    target = share * load * np.array(direction)
    contact = curved.press(Ball(5.0), 1.0, 2.0, load_n=load, friction=1.0, tangential_n=tuple(target))
    assert contact.force_n[:2] @ direction == pytest.approx(share * load)
    assert contact.force_n[2] == pytest.approx(load)
    dragged = contact.displacement_mm[contact.in_contact][:, :2].mean(axis=0) @ direction
    assert dragged < 0, "the skin goes with the indenter, against the force on it"


def test_a_flat_gel_is_symmetric_and_tilted_skin_pushes_sideways(flat, curved):
    contact = flat.press(Ball(5.0), 0.0, 0.0, load_n=1.0)
    np.testing.assert_allclose(
        contact.displacement_mm, contact.displacement_mm[:, ::-1] * (-1, 1, 1), atol=1e-9
    )
    assert contact.force_n[0] == pytest.approx(0, abs=1e-9)
    tilted = curved.press(Ball(5.0), 4.0, 0.0, load_n=1.0)
    assert tilted.force_n[0] > 0.1


def test_first_touch_is_that_of_the_surfaces_not_of_the_nodes(curved):
    a, b, c = CURVED.ellipsoid.semi_axes_mm
    x, y = np.meshgrid(np.linspace(1, 4, 601), np.linspace(-4, -1, 601))
    corner = CURVED.pitch_mm * 31.5
    skin = c * np.sqrt(1 - (x / a) ** 2 - (y / b) ** 2) - c * np.sqrt(
        1 - (corner / a) ** 2 - (corner / b) ** 2
    )
    touch = (skin - Ball(5.0).surface(x - 2.3, y + 2.6)[0]).max()
    contact = curved.press(Ball(5.0), 2.3, -2.6, load_n=0.2)
    assert contact.first_touch_mm == pytest.approx(touch, abs=5e-3)


def test_more_load_sinks_deeper_and_friction_stiffens(curved):
    ways = [-curved.press(Ball(5.0), 0.0, 0.0, load_n=f).indenter_displacement_mm[2] for f in (0.5, 1.0, 1.5)]
    assert 0.3 < ways[0] < ways[1] < ways[2] < 1.5
    rough = -curved.press(Ball(5.0), 0.0, 0.0, load_n=1.0, friction=1.0).indenter_displacement_mm[2]
    assert rough < ways[1]


def test_force_map_sums_to_the_resultant(curved):
    contact = curved.press(Ball(5.0), -1.0, 2.0, load_n=1.2, friction=0.5, tangential_n=(0.3, 0.0))
    x, y = pixel_centres_mm(CURVED)
    image = contact.force_map_n(x[0], y[:, 0])
    assert image.shape == (64, 64, 3)
    np.testing.assert_allclose(image.sum(axis=(0, 1)), contact.force_n, atol=1e-9)
    far = np.hypot(x + 1, y - 2) > 4
    np.testing.assert_allclose(image[far], 0, atol=1e-12)
    with pytest.raises(ContactError, match="farther apart"):
        contact.force_map_n(x[0, ::20], y[::20, 0])


def test_the_deformed_skin_lies_on_the_ball(flat):
    """In contact the skin's depth is the ball's; far away the skin is undeformed."""
    contact = flat.press(Ball(6.0), 0.0, 1.0, load_n=1.0, friction=2.0)
    x, y = pixel_centres_mm(FLAT)
    depth = contact.depth_at(x, y, lambda x, y: np.zeros_like(x))
    skin = contact.mesh.skin_mm
    moved = (skin + contact.displacement_mm)[contact.in_contact]
    np.testing.assert_allclose(
        contact.depth_at(moved[:, 0], moved[:, 1], lambda x, y: np.zeros_like(x)), moved[:, 2], atol=1e-4
    )
    ball = contact.indenter_displacement_mm[2] + Ball(6.0).surface(x, y - 1)[0]
    inside = np.hypot(x, y - 1) < 0.8
    np.testing.assert_allclose(depth[inside], ball[inside], atol=0.05)
    assert np.abs(depth[:4]).max() < 0.02
    np.testing.assert_allclose(
        contact.displacement_at(skin[5:9, 6, 0], skin[5:9, 6, 1]), contact.displacement_mm[5:9, 6]
    )


@pytest.mark.parametrize(
    ("indenter", "x", "keys", "message"),
    [
        (Ball(5.0), 30.0, {"load_n": 1.0}, "expected inside the skin"),
        (Ball(5.0), 7.5, {"load_n": 3.0}, "fixed rim"),
        (Ball(0.1), 0.3, {"load_n": 1.0}, "smaller than the mesh's elements"),
        (Ball(2.4), 0.0, {"load_n": 6.0}, "side|sinks"),
        (FlatPunch(4.0), 0.0, {"load_n": 50.0}, "sinks .* into 3 mm of elastomer"),
        (Ball(5.0), 0.0, {"load_n": 0.0}, "load of more than 0"),
        (Ball(5.0), 0.0, {"load_n": 1.0, "friction": -1.0}, "friction = -1"),
        (
            Ball(5.0),
            0.0,
            {"load_n": 1.0, "friction": 0.2, "tangential_n": (0.5, 0.0)},
            "slides, a friction of 0.2 is too little",
        ),
    ],
)
def test_refuses_what_the_gel_cannot_carry(flat, indenter, x, keys, message):
    with pytest.raises(ContactError, match=message):
        flat.press(indenter, x, 0.0, **keys)
