"""The finite-element probe under successive loads: springs, slip, and dependence on the load's history."""

import numpy as np
import pytest

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.mechanics.fem.contact import Load
from fastac.sensor.mechanics.fem.probe import FemProbe
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.indenter import Ball, Cylinder
from fastac.sensor.mechanics.press import ContactError

FRICTION, LOAD_N = 0.6, 0.5
GEL = {"mechanics": "fem", "friction": FRICTION, "elements": 12, "layers": 2}
BOTTLE = Cylinder(40.0, 400.0)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    sensor = Sensor(geometry="fingertip", height_px=32, width_px=32, pitch_mm=0.5, elastomer=GEL)
    return FemRig(sensor, tmp_path_factory.mktemp("cache"), progress=False)


def sideways(force_n: float, way_z_mm: float, spring_n_per_mm: float = 0.0) -> Load:
    """A load along x (force of the skin on the indenter), with the displacement along y and z prescribed."""
    value, force_controlled = np.array([force_n, 0.0, way_z_mm]), np.array([True, False, False])
    return Load(np.eye(3), force_controlled, value, np.array([spring_n_per_mm, 0.0, 0.0]))


@pytest.fixture
def bottle(rig):
    probe = FemProbe(rig, BOTTLE, 0.0, 0.0)
    probe.at_load(LOAD_N)
    return probe


def test_the_first_load_is_a_press(rig):
    pressed = FemProbe(rig, Ball(5.0), 1.0, -0.5).at_load(LOAD_N)
    contact = rig.gel.press(Ball(5.0), 1.0, -0.5, load_n=LOAD_N, friction=FRICTION)
    np.testing.assert_array_equal(pressed.force_n, contact.force_n)
    assert pressed.pose["approach_mm"] == -contact.indenter_displacement_mm[2]
    assert pressed.in_contact.any()


def test_a_spring_carries_what_its_way_leaves(bottle):
    way_z, spring = bottle.indenter_displacement_mm[2], 0.4
    assert not bottle.apply_load(sideways(-0.2, way_z, spring)).any()
    assert bottle.pressed().force_n[0] == pytest.approx(
        -0.2 + spring * bottle.indenter_displacement_mm[0], abs=1e-7
    )
    assert 0 < bottle.indenter_displacement_mm[0] < 0.2 / spring
    assert bottle.indenter_displacement_mm[2] == pytest.approx(way_z)


def test_friction_is_the_most_that_is_carried_and_beyond_it_slides(bottle):
    way_z, spring = bottle.indenter_displacement_mm[2], 0.4
    slid = sum(bottle.apply_load(sideways(-hand, way_z, spring)) for hand in np.linspace(0.05, 0.6, 12))
    force = bottle.pressed().force_n
    assert np.hypot(*force[:2]) == pytest.approx(FRICTION * force[2], rel=0.02)
    assert np.hypot(*force[:2]) <= FRICTION * force[2] * (1 + 1e-6) + 0.01
    assert 0.1 < slid[0] < bottle.indenter_displacement_mm[0]
    assert not bottle.state.sticking.any()
    before = bottle.indenter_displacement_mm[0]
    more = bottle.apply_load(sideways(-0.7, way_z, spring))
    # Every node slides: skin and force stay, and the whole of the way is slip.
    assert more[0] == pytest.approx(bottle.indenter_displacement_mm[0] - before, rel=1e-3)
    assert bottle.pressed().force_n == pytest.approx(force, abs=2e-3)


def test_what_slid_stays_where_it_slid_to(bottle):
    way_z, spring = bottle.indenter_displacement_mm[2], 0.4
    slid = sum(bottle.apply_load(sideways(-hand, way_z, spring))[0] for hand in np.linspace(0.05, 0.6, 12))
    for carried in (0.2, 0.1, 0.0):
        assert not bottle.apply_load(sideways(-carried, way_z)).any()
    assert bottle.indenter_displacement_mm[0] > 0.9 * slid


def test_without_a_spring_too_much_is_an_error_and_changes_nothing(bottle):
    before = bottle.state
    with pytest.raises(ContactError, match=r"Cylinder at x = 0 mm, y = 0 mm: no equilibrium"):
        bottle.apply_load(sideways(-2 * FRICTION * LOAD_N, bottle.indenter_displacement_mm[2]))
    assert bottle.state is before


def test_refuses_what_sinks_deeper_than_it_was_to_reach(rig):
    with pytest.raises(ContactError, match="the skin reaches the indenter's side"):
        FemProbe(rig, BOTTLE, 0.0, 0.0, reach_mm=0.1).at_load(2.0)


def test_fewer_nodes_stick_as_the_pull_rises_and_none_when_all_slide(rig):
    probe = FemProbe(rig, BOTTLE, 0.0, 0.0, friction=FRICTION / 2)
    assert probe.state.sticking_share == 0
    probe.at_load(LOAD_N)
    shares = [probe.state.sticking_share]
    for share in (0.3, 0.6, 0.9):
        value = np.array([-share * FRICTION / 2 * LOAD_N, 0.0, LOAD_N])
        probe.apply_load(Load(np.eye(3), np.ones(3, bool), value))
        shares.append(probe.state.sticking_share)
    assert shares == sorted(shares, reverse=True)
    assert 0 < shares[-1] < shares[1] < shares[0]
    way_z = probe.indenter_displacement_mm[2]
    probe.apply_load(sideways(-FRICTION * LOAD_N, way_z, 0.4))
    assert probe.state.sticking_share == 0
