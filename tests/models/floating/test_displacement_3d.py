import numpy as np
import pytest
import torch

from fastac.models.floating.displacement_3d import MAX_LOST, displacement_fields
from fastac.models.floating.network import PixelNetwork
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.vision.markers import MarkerError

SIZE, PITCH = 64, 0.1
GRID = np.stack(np.meshgrid(np.arange(8, 60, 10.0), np.arange(8, 60, 10.0)), axis=-1).reshape(-1, 2)


def picture(centres_px):
    """Soft dark dots of 5 px on a bright skin, (SIZE, SIZE, 4)."""
    v, u = np.indices((SIZE, SIZE))
    distance = np.sqrt((u[..., None] - centres_px[:, 0]) ** 2 + (v[..., None] - centres_px[:, 1]) ** 2)
    light = 180 - 160 * np.clip(3 - distance, 0, 1).max(axis=-1, initial=0)
    return np.repeat(light[..., None], 4, axis=-1).astype(np.uint8)


@pytest.fixture(scope="module")
def make_pipeline(make_scene):
    def make(**sensor):
        size = {"geometry": "flat", "height_px": SIZE, "width_px": SIZE, "pitch_mm": PITCH}
        scene = make_scene(sensor=size | {"markers": {"spacing_mm": 1.0, "radius_mm": 0.25}} | sensor)
        torch.manual_seed(1)
        network = PixelNetwork(6, (4,))
        return FloatPipeline(scene, network, picture(GRID), np.zeros((SIZE, SIZE)))

    return make


@pytest.fixture(scope="module")
def pipeline(make_pipeline):
    return make_pipeline()


def shifted(dx, dy):
    return picture(GRID + np.array([dx, dy]))


def test_the_markers_motion_and_the_pipeline_s_depth(pipeline):
    frames = np.stack([shifted(1.5, -0.5), picture(GRID), shifted(0, 2)])
    found = displacement_fields(pipeline, frames)
    assert found.field_mm.shape == (3, 3, SIZE - 2, SIZE - 2)
    assert found.field_mm.dtype == np.float32
    assert found.kept.all()
    assert not found.lost.any()
    u, v = GRID.astype(int).T - 1  # of the inner pixels
    at_markers = found.field_mm[:, :2, v, u]
    expected = PITCH * np.array([[1.5, -0.5], [0, 0], [0, 2]])[..., None]
    np.testing.assert_allclose(at_markers, np.broadcast_to(expected, at_markers.shape), atol=0.1 * PITCH)
    normal = pipeline.run(frames, wanted=["displacement_mm"]).displacement_mm
    np.testing.assert_array_equal(found.field_mm[:, 2], normal)
    assert np.abs(normal).max() > 0


def test_nothing_moves_at_rest(pipeline):
    assert not displacement_fields(pipeline, picture(GRID)[None]).field_mm.any()


def test_frames_without_their_markers_are_left_out(pipeline):
    """A frame that lacks a single dot is kept; its field comes from the other dots."""
    some = np.arange(len(GRID)) != 14
    few = np.arange(len(GRID)) % 2 == 0
    frames = np.stack(
        [picture(GRID[few] + 1), picture(GRID[some] + 1), picture(np.empty((0, 2))), shifted(1, 1)]
    )
    found = displacement_fields(pipeline, frames)
    assert found.kept.tolist() == [False, True, False, True]
    assert found.lost.tolist() == [18, 1, 36, 0]
    assert 1 <= MAX_LOST * len(GRID) < 18
    assert found.field_mm.shape[0] == 2
    assert np.isfinite(found.field_mm).all()
    np.testing.assert_allclose(found.field_mm[0, :2], found.field_mm[1, :2], atol=0.2 * PITCH)


def test_all_frames_lost(pipeline):
    with pytest.raises(MarkerError, match="too many lost in each of 2 frames"):
        displacement_fields(pipeline, np.stack([picture(np.empty((0, 2)))] * 2))


def test_a_scene_without_markers(make_pipeline):
    with pytest.raises(MarkerError, match=r"scene tiny: sensor.markers: missing"):
        displacement_fields(make_pipeline(markers=None), picture(GRID)[None])
