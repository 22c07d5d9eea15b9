import pytest

from fastac.scenes.schema import SceneError, parse

BY_FORCE = """name = "x"
outputs = ["force_z"]
poisson.solver = "adjoint"
force = { clamp = false, fit = "slopes" }
training = { labels = "force" }
sensor = { geometry = "flat", source = "recorded" }
"""


def test_forces_alone_train_a_flat_recorded_sensor():
    assert parse(BY_FORCE, origin="x").force_from_slopes


@pytest.mark.parametrize(
    ("given", "expected"), [("", 0.01), (", light_noise = 0", 0), (", light_noise = 0.03", 0.03)]
)
def test_light_differs_by_a_hundredth_where_the_scene_does_not_say(given, expected):
    text = BY_FORCE.replace('"force" }', f'"force"{given} }}')
    assert parse(text, origin="x").training.force_light_noise == expected


def test_presses_are_moved_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('"force" }', '"force", press_reach = 0.1 }')
    assert [parse(text, origin="x").training.force_reach for text in texts] == [0.05, 0.1]
    geometry = parse(BY_FORCE.replace('training = { labels = "force" }', ""), origin="x")
    assert geometry.training.force_reach == 0


def test_the_curl_of_slopes_counts_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('"force" }', '"force", curl_weight = 0.3 }')
    assert [parse(text, origin="x").training.force_curl_weight for text in texts] == [1, 0.3]
    geometry = parse(BY_FORCE.replace('training = { labels = "force" }', ""), origin="x")
    assert geometry.training.force_curl_weight == 0


def test_the_rate_on_whole_frames_is_that_of_the_normals_where_the_scene_does_not_say():
    texts = ("normals_learning_rate = 0.004", "depth_learning_rate = 0.005")
    geometry = [BY_FORCE.replace('labels = "force"', text) for text in texts]
    assert [parse(text, origin="x").training.sums_learning_rate for text in geometry] == [0.004, 0.005]


def test_presses_may_be_symmetric_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('"force" }', '"force", press_symmetry = false }')
    assert [parse(text, origin="x").training.force_symmetry for text in texts] == [True, False]
    geometry = parse(BY_FORCE.replace('training = { labels = "force" }', ""), origin="x")
    assert not geometry.training.force_symmetry


def test_light_is_the_same_in_all_frames_where_normals_train():
    text = BY_FORCE.replace('training = { labels = "force" }', "")
    assert parse(text, origin="x").training.force_light_noise == 0


def test_the_search_for_a_size_of_weights_is_cut_short_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('training = { labels = "force" }', "")
    of_force, of_geometry = (parse(text, origin="x").training for text in texts)
    assert of_force.patience_sizes == 3
    assert of_geometry.patience_sizes is None
    assert of_geometry.model_copy(update={"patience_epochs": 5}).patience_sizes == 5


def test_a_network_has_a_width_or_one_for_each_layer():
    text = 'name = "x"\noutputs = ["depth"]\nsensor.geometry = "flat"\n[network]\nwidth = {}'
    assert parse(text.format(12), origin="x").network.hidden == (12, 12, 12)
    assert parse(text.format([16, 13, 10]), origin="x").network.hidden == (16, 13, 10)
    for wrong in ("3", "65", "[16, 13]", "[16, 13, 3]", "true", "8.5", '"16"'):
        with pytest.raises(SceneError) as refusal:
            parse(text.format(wrong), origin="x")
        assert "network.width = " in str(refusal.value)
        assert "expected a number from 4 to 64, or a list of three" in str(refusal.value)


def test_a_network_may_be_trained_wider_than_it_is_wanted():
    text = 'name = "x"\noutputs = ["depth"]\nsensor.geometry = "flat"\n[network]\nwidth = [12, 8, 6]\n{}'
    assert parse(text.format(""), origin="x").network.trained == (12, 8, 6)
    found = parse(text.format("train_width = 16"), origin="x")
    assert (found.network.trained, found.network.hidden) == ((16, 16, 16), (12, 8, 6))
    assert parse(text.format("train_width = [12, 9, 6]"), origin="x").network.trained == (12, 9, 6)
    for wrong, expected in (
        ("[12, 7, 6]", "network.train_width: 7 in hidden layer 2: expected at least the 8 of network.width"),
        ("3", "network.train_width = 3: expected a number from 4 to 64, or a list of three"),
    ):
        with pytest.raises(SceneError) as refusal:
            parse(text.format(f"train_width = {wrong}"), origin="x")
        assert str(refusal.value).startswith(f"x: {expected}")
