"""Distances from a contact circle, and the skin at rest."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.models.training.around_contacts import at_rest, circle_radii


def test_distances_are_in_radii(tiny_data):
    count = len(tiny_data)
    circles = {"center_px": np.full((count, 2), (4.0, 7.0)), "radius_px": np.full(count, 2.0)}
    circles["radius_px"][1] = np.nan
    data = replace(tiny_data, indenter=circles)
    radii = circle_radii(data, 0)
    assert radii[7, 4] == 0
    assert radii[7, 8] == 2  # four pixels along u
    assert radii[10, 4] == 1.5  # three along v
    assert circle_radii(data, 1) is None
    assert circle_radii(replace(data, indenter=None), 0) is None


def test_the_skin_at_rest_is_the_background(tiny_data):
    with pytest.raises(ValueError, match="none equals the background"):
        at_rest(tiny_data)
    frames = tiny_data.frames.copy()
    frames[3] = tiny_data.background
    valid = np.arange(len(frames) * 256).reshape(len(frames), 16, 16) % 3 > 0
    known, normals = at_rest(replace(tiny_data, frames=frames, valid=valid))
    np.testing.assert_array_equal(known, valid[3])
    np.testing.assert_array_equal(normals, tiny_data.normals[3])
