from collections import Counter

import numpy as np
import pytest

from fastac.scenes.schema import parse
from fastac.sensor.protocol import FingertipError, positions_mm, stations

TEXT = """
name = "p"
outputs = ["force_xyz"]
[sensor]
geometry = "flat"
[sensor.elastomer]
mechanics = "fem"
friction = 0.8
[protocol]
train_grid = 2
validation_grid = 1
test_grid = 2
loads_n = [0.5, 1.0]
"""


def scene(extra=""):
    return parse(TEXT + extra, origin="p")


def test_each_vertical_load_is_followed_by_its_tangential_ones():
    found = stations(scene())
    assert [(s.split, s.load_n) for s in found[:3]] == [("train", 0.5), ("train", 1.0), ("train", 0.5)]
    assert len(found) == (4 + 1 + 4) * 2
    assert found[0].targets_n[0] == (0, 0)
    sizes = [np.hypot(*t) / found[1].load_n for t in found[1].tangential_n]
    np.testing.assert_allclose(sizes, [0.3] * 4 + [0.6] * 4)
    np.testing.assert_allclose(np.sum(found[1].tangential_n, axis=0), 0, atol=1e-15)


def test_further_balls_come_last_each_to_all_parts_of_train_and_validation():
    found = stations(scene("more_balls_mm = [10.0, 20.0]"))
    known = stations(scene())
    assert found[: len(known)] == known
    assert {station.ball_mm for station in known} == {5.0}
    more = found[len(known) :]
    assert Counter(station.split for station in more) == {"train": 8, "validation": 2}
    assert [station.ball_mm for station in more[::2]] == [10, 20, 20, 10, 10]
    assert [(s.x_mm, s.y_mm, s.load_n, s.tangential_n) for s in more] == [
        (s.x_mm, s.y_mm, s.load_n, s.tangential_n) for s in known if s.split != "test"
    ]


def test_fewer_loads_at_a_position_come_in_turn_and_each_object_meets_all():
    found = stations(scene("more_balls_mm = [10.0, 20.0]\nloads_per_position = 1"))
    known = stations(scene("more_balls_mm = [10.0, 20.0]"))
    assert [s for s in found if s.split == "test"] == [s for s in known if s.split == "test"]
    learned = [station for station in found if station.split == "train"]
    assert all(station in known for station in learned)
    assert [(s.ball_mm, s.load_n) for s in learned] == [
        *((5, 0.5), (5, 0.5), (5, 1), (5, 1)),
        *((10, 0.5), (20, 0.5), (20, 1), (10, 1)),
    ]


@pytest.mark.parametrize("more", [(10.0,), (10.0, 20.0), (10.0, 20.0, 40.0)])
@pytest.mark.parametrize("count", [1, 2])
def test_loads_in_turn_are_spread_evenly_over_objects(more, count):
    text = TEXT.replace("train_grid = 2", "train_grid = 12").replace("[0.5, 1.0]", "[0.5, 1.0, 1.5]")
    of_all = stations(parse(text + f"more_balls_mm = {list(more)}", origin="p"))
    found = stations(parse(text + f"more_balls_mm = {list(more)}\nloads_per_position = {count}", origin="p"))
    known, expected = (
        Counter((s.ball_mm, s.load_n) for s in each if s.split == "train") for each in (found, of_all)
    )
    assert known == {key: every * count / 3 for key, every in expected.items()}


def test_further_shapes_take_turns_with_further_balls():
    found = stations(scene('more_balls_mm = [10.0]\nmore_shapes = ["cylinder", "edge"]'))
    known = stations(scene("more_balls_mm = [10.0]"))
    assert len(found) == len(known)
    more = found[len(stations(scene())) :]
    assert [station.shape for station in more[::2]] == ["ball", "cylinder", "cylinder", "edge", "ball"]
    assert [np.isnan(station.ball_mm) for station in more] == [station.shape != "ball" for station in more]
    # One object and place is one group, whatever the loads, and each random object has a draw of its own.
    objects = {station.group: station.draw for station in found}
    assert len(objects) == len(found) / 2
    assert len({draw for draw in objects.values() if draw}) == 3


def test_default_grids_are_the_papers():
    """192, 75 and 192 vertical presses on 8×8, 5×5 and 8×8 places (supplement I)."""
    found = stations(parse(TEXT.split("[protocol]")[0], origin="p"))
    assert Counter(station.split for station in found) == {"train": 192, "validation": 75, "test": 192}


@pytest.mark.parametrize(
    ("old", "new", "shares"),
    [
        ("", "", (0.3, 0.6)),
        ('"force_xyz"', '"force_z"', ()),
        ("friction = 0.8", "", ()),
        ("train_grid = 2", "train_grid = 2\ntangential_shares = [0.1]", (0.1,)),
        ("train_grid = 2", "train_grid = 2\ntangential_shares = []", ()),
        ('["force_xyz"]', '["depth"]', ()),
    ],
)
def test_tangential_loads_are_those_that_the_scene_wants_and_friction_allows(old, new, shares):
    found = parse(TEXT.replace(old, new) if old else TEXT, origin="p")
    assert found.tangential_shares == shares
    assert len(stations(found)[0].tangential_n) == 4 * len(shares)


def test_positions_between_four_corners_are_bilinear():
    rectangle = positions_mm(scene().sensor, scene().protocol)
    reach = 7.9375 - 1.5 - 1.5
    box = [[-reach, -reach], [reach, -reach], [-reach, reach], [reach, reach]]
    same = scene(f"corners_mm = {box}")
    for split, found in positions_mm(same.sensor, same.protocol).items():
        np.testing.assert_allclose(found, rectangle[split], atol=1e-12)
    skewed = scene("corners_mm = [[-4.0, -3.0], [3.0, -4.0], [-2.0, 5.0], [4.0, 3.0]]")
    found = positions_mm(skewed.sensor, skewed.protocol)
    np.testing.assert_allclose(found["train"][0], (-4, -3))
    np.testing.assert_allclose(found["test"][-1], (4, 3))
    # Of 4 x 4 points, the second train point along x is the third: two thirds of the upper edge.
    np.testing.assert_allclose(found["train"][1], (-4 + 7 * 2 / 3, -3 - 2 / 3))


def test_refuses_corners_beside_the_skin():
    far = scene("corners_mm = [[-4, -3], [3, -4], [-2, 9], [4, 3]]")
    with pytest.raises(FingertipError, match=r"protocol\.corners_mm = -2, 9: expected inside the skin"):
        stations(far)
