from dataclasses import replace

import numpy as np
import pytest

from fastac.flow.few_presses import AdaptError, known_presses, pixels_of, pressed_skins, presses, read
from fastac.sensor import dataset


def test_frames_at_one_place_are_of_one_press(tiny_data):
    """The tiny dataset presses each of its 17 places with two loads."""
    found = presses(tiny_data)
    names, counts = np.unique(found, return_counts=True)
    assert "" not in names
    assert (len(names), set(counts)) == (17, {2})
    assert len(known_presses(tiny_data)) == 13


def test_recordings_and_places(tiny_data):
    count = len(tiny_data)
    group = np.array(["a", "b"])[np.arange(count) % 2]
    assert len(set(presses(replace(tiny_data, group=group)))) == count
    assert set(presses(replace(tiny_data, group=group, indenter=None))) == {"a: 0", "b: 0"}
    assert len(set(presses(replace(tiny_data, indenter=None)))) == 1


def test_frames_without_contact_are_of_no_press(tiny_data):
    frames = tiny_data.frames.copy()
    frames[3] = tiny_data.background
    x_mm = tiny_data.indenter["x_mm"].copy()
    x_mm[5] = np.nan
    found = presses(replace(tiny_data, frames=frames, indenter=tiny_data.indenter | {"x_mm": x_mm}))
    assert np.flatnonzero(found == "").tolist() == [3, 5]


def test_depth_is_learned_where_the_bundle_learned_it_and_all_of_it_is_known(tiny_data, tiny_bundle):
    chosen = np.arange(len(tiny_data)) < 5
    assert pressed_skins(tiny_bundle, tiny_data, tiny_data, chosen) is None
    scene = tiny_bundle.scene
    learned = {"depth_weight": 1.0, "force_weight": 0.1}
    scene = scene.model_copy(update={"training": scene.training.model_copy(update=learned)})
    bundle = replace(tiny_bundle, pipeline=tiny_bundle.pipeline.replace(scene=scene))
    assert bundle.scene == scene
    found = pressed_skins(bundle, tiny_data, tiny_data, chosen)
    settings = found.scene.training
    assert (settings.depth_weight, settings.force_weight) == (1.0, 0.0)  # too few presses for the force
    assert found.data.indices("train").tolist() == found.skin.indices("train").tolist() == list(range(5))
    np.testing.assert_array_equal(found.rest_depth_mm, tiny_data.rest_depth_mm)
    without = replace(tiny_data, rest_depth_mm=None)
    rest_mm = pressed_skins(bundle, without, without, chosen).rest_depth_mm
    np.testing.assert_array_equal(rest_mm, bundle.pipeline.rest_depth_mm)
    unknown = replace(tiny_data, depth_mm=None)
    assert pressed_skins(bundle, unknown, unknown, chosen) is None


def test_pixels_of_chosen_frames(tiny_data, tiny_scene):
    chosen = np.zeros(len(tiny_data), bool)
    chosen[[0, 4]] = True
    x, y = pixels_of(tiny_data, tiny_scene, chosen)
    assert x.shape == (2 * 256, 6)
    np.testing.assert_array_equal(y, tiny_data.normals[[0, 4]].reshape(-1, 3))
    thinned = tiny_scene.training.model_copy(update={"normals_share": 0.25})
    again, _ = pixels_of(tiny_data, tiny_scene.model_copy(update={"training": thinned}), chosen)
    np.testing.assert_array_equal(again, x)  # few presses are not thinned


def test_what_cannot_be_learned_from(tiny_data, tiny_scene, make_scene, tmp_path):
    def written(name, **changes):
        kept = ("pitch_mm", "channels", "source", "background", "frames", "split", "normals", "indenter")
        given = {key: getattr(tiny_data, key) for key in kept} | changes
        dataset.write(tmp_path / name, **given)
        return tmp_path / name

    file = written("bare.h5", normals=None)
    with pytest.raises(AdaptError, match=rf"^{file}: normals: missing"):
        read(file, tiny_scene, store=tmp_path)
    file = written("test.h5", split=np.full(len(tiny_data), "test"))
    with pytest.raises(AdaptError, match=rf"^{file}: split: no frame in contact outside of 'test'$"):
        read(file, tiny_scene, store=tmp_path)
    forces = make_scene(
        outputs=["force_z"],
        poisson={"mode": "difference", "solver": "adjoint"},
        force={"clamp": False, "fit": "slopes"},
        training={"labels": "force"},
    )
    with pytest.raises(AdaptError, match=r"^scene tiny: training\.labels = 'force': expected 'geometry'"):
        read(written("whole.h5"), forces, store=tmp_path)
    for key in ("force_weight", "force_steps"):
        bent = forces.training.model_copy(update={"labels": "geometry", key: 3})
        bent = forces.model_copy(update={"training": bent})
        with pytest.raises(AdaptError, match=rf"^scene tiny: training\.{key} = 3: expected 0"):
            read(tmp_path / "whole.h5", bent, store=tmp_path)
    kernels = make_scene(training={"depth_weight": 1.0, "force_weight": 0.1})  # its normals are the skin's
    assert len(read(tmp_path / "whole.h5", kernels, store=tmp_path)) == len(tiny_data)
