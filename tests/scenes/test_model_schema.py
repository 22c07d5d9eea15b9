import pytest

from fastac.scenes.schema import SceneError, parse


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
