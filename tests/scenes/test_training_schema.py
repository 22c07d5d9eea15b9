import pytest

from fastac.scenes.schema import parse

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
    assert of_force.patience_sizes == 2
    assert of_geometry.patience_sizes is None
    assert of_geometry.model_copy(update={"patience_epochs": 5}).patience_sizes == 5


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("normals_epochs = 3", False),
        ("depth_weight = 0.5", True),
        ("force_weight = 0.1", True),
        ("force_steps = 2", True),
    ],
)
def test_whether_sums_of_slopes_are_learned_from(text, expected):
    assert parse(BY_FORCE.replace('labels = "force"', text), origin="x").training.learns_sums == expected
