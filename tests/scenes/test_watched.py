"""What a watched scene means to a store; tests/fastac/store/test_watched.py has what reading it tells."""

import pytest

from fastac.scenes.watched import ALL_FIELDS


def test_unwatched_is_the_scene_behind_all_watching(make_scene):
    scene = make_scene()
    assert scene.unwatched() is scene
    watched = scene.watched(lambda path, value: None)
    assert watched is not scene
    assert watched.unwatched() is scene
    assert watched.watched(lambda path, value: None).unwatched() is scene


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({}, True),
        ({"kernel_size": 5}, True),
        ({"hidden": 9}, False),
        ({"hidden": 9, "clamp": False}, False),
    ],
    ids=["defaults", "another field changed", "one added field changed", "both added fields changed"],
)
def test_fields_that_were_added_at_their_default_change_nothing(make_scene, changes, same):
    """As if `force` had been written when it had no `hidden` and no `clamp`."""
    scene = make_scene(force=changes)
    before = sorted(set(type(scene.force).model_fields) - {"hidden", "clamp"})
    assert scene.means_the_same(f"force.{ALL_FIELDS}", before) == same
    # A field that is gone, or a path of one value, never means the same.
    assert not scene.means_the_same(f"force.{ALL_FIELDS}", [*before, "gone"])
    assert not scene.means_the_same("force.hidden", before)
