"""Drags on a small gel: forces are those asked for, and ever fewer nodes stick."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.sensor.mechanics.indenter import Ball
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.mechanics.rig import rig_of
from fastac.studies.slip.drags import OBJECTS, PLACES, SHARES, drags, steps


@pytest.fixture(scope="module")
def scene(slip_bundle):
    return slip_bundle.scene


@pytest.fixture(scope="module")
def rig(scene, tiny_rig_cache):
    return rig_of(scene.sensor, tiny_rig_cache, progress=False)


def test_every_object_place_load_and_friction_once(scene):
    found = drags(scene)
    assert len(set(found)) == len(found) == len(OBJECTS) * len(PLACES) * len(scene.protocol.loads_n) * 2
    assert {drag.friction for drag in found} == {0.8, 0.4}
    spacing_mm = scene.sensor.markers.spacing_mm
    assert {(drag.x_mm, drag.y_mm) for drag in found} == {(0, 0), (0.5 * spacing_mm, 0.3125 * spacing_mm)}


@pytest.mark.parametrize("half", [False, True])
def test_pulls_are_shares_of_what_friction_carries(scene, rig, half):
    drag = drags(scene, {"ball": Ball(8.0)})[-1 if half else 0]
    assert drag.friction == (0.4 if half else 0.8)
    found = list(steps(rig, drag))
    assert [step.share for step in found] == list(SHARES)
    force_n = np.array([step.pressed.force_n for step in found])
    np.testing.assert_allclose(force_n[:, 0], -drag.friction * drag.load_n * np.array(SHARES), atol=1e-7)
    np.testing.assert_allclose(force_n[:, 1:], [[0, drag.load_n]] * len(SHARES), atol=1e-7)
    sticking = [step.sticking for step in found]
    assert sticking[0] > 0.3
    assert sticking[-1] < 0.3
    assert np.diff(sticking).mean() < 0


def test_an_object_beside_the_skin(scene, rig):
    drag = replace(drags(scene)[0], x_mm=50.0)
    with pytest.raises(ContactError, match="expected inside the skin"):
        list(steps(rig, drag))
