import numpy as np
import pytest

from fastac.tune.groups import TuneError
from fastac.tune.space import (
    CIRCLES,
    DEPTH,
    FORCE,
    FORCE_ALONE,
    FORCE_OF_KERNELS,
    FORCE_OF_SLOPES,
    GEOMETRY,
    axes_of,
    candidates,
)


def test_axes_follow_the_labels(make_scene, tiny_scene):
    from_force = make_scene(
        outputs=["force_z"],
        poisson={"mode": "difference", "solver": "adjoint"},
        force={"clamp": False, "fit": "slopes"},
        training={"labels": "force"},
    )
    assert axes_of(from_force) == FORCE
    of_slopes = from_force.training.model_copy(update={"labels": "geometry"})
    of_slopes = from_force.model_copy(update={"training": of_slopes})
    assert axes_of(of_slopes) == GEOMETRY | FORCE_OF_SLOPES
    alone = of_slopes.training.model_copy(update={"force_steps": 10})
    assert axes_of(of_slopes.model_copy(update={"training": alone})) == GEOMETRY | FORCE_ALONE
    assert axes_of(tiny_scene) == GEOMETRY
    assert axes_of(tiny_scene, circles=True) == GEOMETRY | CIRCLES
    assert axes_of(tiny_scene, circles=True, depth=True) == GEOMETRY | CIRCLES | DEPTH | FORCE_OF_KERNELS
    assert axes_of(make_scene(outputs=["depth"]), depth=True) == GEOMETRY | DEPTH
    assert axes_of(make_scene(outputs=["normals"]), depth=True) == GEOMETRY
    assert axes_of(from_force, circles=True, depth=True) == FORCE
    found = axes_of(tiny_scene, ["network.width=8, 12", "training.teachers=0"], ["training.input_noise"])
    assert (found["network.width"], found["training.teachers"]) == ([8, 12], [0])
    assert "training.input_noise" not in found


@pytest.mark.parametrize("text", ["network.width", "network.width=", "network.width=8,,", "=3"])
def test_texts_that_say_no_axis(tiny_scene, text):
    with pytest.raises(TuneError, match=r"^--vary '.*': expected KEY=VALUE"):
        axes_of(tiny_scene, [text])


def test_unknown_keys(tiny_scene):
    with pytest.raises(
        TuneError, match=r"^--keep 'training.seed': is not searched; there are sensor.level_light, network.s"
    ):
        axes_of(tiny_scene, keep=["training.seed"])
    with pytest.raises(TuneError, match=r"^nowhere.width = 8: a scene has no such key"):
        candidates(tiny_scene, {"nowhere.width": [8]}, 3, seed=1)


def test_candidates(tiny_scene):
    found = candidates(tiny_scene, axes_of(tiny_scene), 12, seed=1)
    assert len(found) == 12
    assert (found[0].axes, found[0].scene) == ({}, tiny_scene)
    assert len({point.scene.model_dump_json() for point in found}) == 12
    assert found == candidates(tiny_scene, axes_of(tiny_scene), 12, seed=1)
    assert found != candidates(tiny_scene, axes_of(tiny_scene), 12, seed=2)
    paired = {(p.scene.training.normals_batch_px, p.scene.training.normals_learning_rate) for p in found}
    own = tiny_scene.training.normals_batch_px, tiny_scene.training.normals_learning_rate
    assert paired <= {own, (256, 3e-3), (1024, 6e-3), (2048, 1e-2)}


def test_half_of_the_candidates_are_near_the_scene(tiny_scene):
    axes = axes_of(tiny_scene)
    _, *others = candidates(tiny_scene, axes, 41, seed=1)
    every = {key for axis in axes for key in axis.split(", ")}
    near = [point for point in others if set(point.axes) != every]
    assert 16 <= len(near) <= 20  # near ones are more often equal to one that is there
    assert {key for point in near for key in point.axes} == every
    assert 2 <= np.mean([len(point.axes) for point in near]) <= 3  # keys; one of the axes has two


def test_what_there_are_no_more_of(tiny_scene):
    own = tiny_scene.training.input_noise
    found = candidates(tiny_scene, {"training.input_noise": [own, own + 0.1]}, 9, seed=1)
    assert [point.axes for point in found] == [{}, {"training.input_noise": own + 0.1}]
    impossible = candidates(tiny_scene, {"training.input_noise": [7.0]}, 9, seed=1)
    assert [point.axes for point in impossible] == [{}]
    assert len(candidates(tiny_scene, {}, 9, seed=1)) == 1
