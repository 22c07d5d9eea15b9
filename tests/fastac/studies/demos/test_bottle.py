"""The bottle between the fingers: hand, weight and fingers move it, and it slips where friction gives way."""

import numpy as np
import pytest

from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.protocol import FingertipError
from fastac.studies.demos.bottle import Grasp, HeldBottle

STEPS = 24


@pytest.fixture(scope="module")
def rig(tiny_rig_scene, tiny_rig_cache):
    return rig_of(tiny_rig_scene.sensor, tiny_rig_cache, progress=False)


@pytest.fixture(scope="module")
def grasp(tiny_rig_scene):
    return Grasp().of_scene(tiny_rig_scene)


def push(hold, most_n, tightened_deg=0.0):
    """Once down and up; the forces on the way, (STEPS, 3)."""
    shape = np.sin(np.pi * np.arange(STEPS) / STEPS) ** 2
    forces = [hold.step(most_n * share, tightened_deg).force_n for share in shape]
    hold.step(0.0, tightened_deg)
    return np.array(forces)


def test_forces_are_shares_of_the_largest_load(grasp, tiny_rig_scene):
    assert grasp.grip_n == pytest.approx(0.02)
    assert grasp.pushes_n == pytest.approx((0.012, 0.024, 0.036, 0.048))
    assert Grasp(grip_n=0.03, pushes_n=(0.1,)).of_scene(tiny_rig_scene).pushes_n == (0.1,)


def test_the_hand_pushes_smoothly_and_leaves(grasp):
    period = grasp.push_s + grasp.pause_s
    assert grasp.seconds == pytest.approx(grasp.pause_s + 4 * period)
    for k, most in enumerate(grasp.pushes_n):
        start = grasp.pause_s + k * period
        assert grasp.push_n(start + grasp.push_s / 2) == pytest.approx(most)
        assert grasp.push_n(start + grasp.push_s + 0.01) == 0
    assert grasp.push_n(0.1) == grasp.push_n(grasp.seconds + 1) == 0


def test_fingers_carry_weight_and_hand_in_halves(rig, grasp):
    hold = HeldBottle(rig, grasp)
    forces = hold.probe.pressed().force_n
    assert forces[0] == pytest.approx(-grasp.weight_n / 2, abs=1e-7)
    assert forces[2] == pytest.approx(grasp.grip_n, rel=0.05)
    forces = hold.step(0.01, 0.0).force_n
    assert 0 < hold.hand_n < 0.01
    assert forces[0] == pytest.approx(-(grasp.weight_n + hold.hand_n) / 2, abs=1e-7)


def test_a_little_push_is_carried_and_a_strong_one_slips(rig, grasp):
    friction = rig.sensor.elastomer.friction
    hold = HeldBottle(rig, grasp)
    forces = push(hold, 0.3 * friction * grasp.grip_n)
    assert hold.slipped_mm == 0
    assert (np.hypot(*forces.T[:2]) < friction * forces[:, 2]).all()
    forces = push(hold, 6 * friction * grasp.grip_n)
    assert hold.slipped_mm > 0.01
    assert hold.lowered_mm > 0.9 * hold.slipped_mm
    # However hard the hand pushes, no more than the friction arrives at the fingers.
    assert (np.hypot(*forces.T[:2]) / forces[:, 2]).max() == pytest.approx(friction, rel=0.05)


def test_a_tighter_grip_holds_against_the_same_push(rig, grasp):
    slipped = []
    for tightened_deg in (0.0, 0.1):
        hold = HeldBottle(rig, grasp)
        hold.step(0.0, tightened_deg)
        push(hold, 3 * rig.sensor.elastomer.friction * grasp.grip_n, tightened_deg)
        slipped.append(hold.slipped_mm)
    assert slipped[0] > 0
    assert slipped[1] == 0


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"lever_mm": 0.0}, "lever_mm = 0.0: expected more than 0"),
        ({"grip_n": -1.0}, "grip_n = -1.0: expected more than 0"),
        ({"pushes_n": ()}, r"pushes_n = \(\): expected more than 0"),
        ({"push_s": float("nan")}, "push_s = nan: expected more than 0"),
        ({"weight_n": 1.0}, "weight_n = 1: expected less than the 0.032 N that friction carries"),
    ],
)
def test_refuses_what_cannot_be(keys, message, tiny_rig_scene):
    with pytest.raises(FingertipError, match=message):
        Grasp(**keys).of_scene(tiny_rig_scene)
