"""Ways to train on shapes: what their scenes share, what is measured of each, and the tables."""

import pytest
from command_line import succeed

from fastac.sensor.protocol import stations
from fastac.studies.shapes import mixtures


@pytest.fixture
def small(monkeypatch, tiny_rig_scene):
    """Two ways on the tiny rig, which is trained in a second."""

    def scene_of(way, seed):
        changes = {"seed": seed, **mixtures.WAYS[way].get("training", {})}
        training = tiny_rig_scene.training.model_copy(update=changes)
        return tiny_rig_scene.model_copy(update={"name": f"{way}-{seed}", "training": training})

    monkeypatch.setattr(mixtures, "scene_of", scene_of)


def test_all_ways_press_equally_often():
    scenes = [mixtures.scene_of(way, 1) for way in mixtures.WAYS]
    assert len({len(stations(scene)) for scene in scenes}) == 1
    assert len({scene.name for scene in scenes}) == len(scenes)
    assert [bool(scene.protocol.more_shapes) for scene in scenes] == [False] * 4 + [True] * 2
    assert [scene.training.still_share for scene in scenes] == [1, 1, 1, 0.1, 0.1, 0.1]
    assert [scene.training.huber_delta for scene in scenes] == [0, 0.1, 0, 0, 0, 0]
    assert [scene.training.depth_weight for scene in scenes] == [0, 0, 0.5, 0, 0, 0]


@pytest.mark.full
def test_a_way_is_trained_and_its_friction_found(small, tmp_path):
    content = mixtures.measure(tmp_path, ways=("balls",), seeds=1, count=2, progress=False)
    assert content["ways"] == {"balls": ["balls-1"]}
    assert content["slip_test"]["balls-1"]["true_ratio"] == pytest.approx(0.8, rel=0.1)
    first, second = mixtures.tables(content | {"known_ball": {"balls-1": KNOWN}})
    assert first.rows[0][0] == "balls"
    assert first.rows[0][2:] == ["1", "2", "3", "4.0"]
    assert [row[0] for row in second.rows] == [*content["by_kind"]]
    for table in (first, second):
        assert all(len(row) == len(table.head) for row in table.rows)
        assert table.note.endswith("simulated")


def test_the_command_says_what_it_is():
    assert "training.still_share" in succeed("study", "mixtures", "--help").output


KNOWN = {"force_x_mae_n": 0.001, "force_y_mae_n": 0.002, "force_z_mae_n": 0.003, "depth_mae_mm": 0.004}
