"""From a recording to a scene, with every figure that leads to it."""

import json
from concurrent.futures import ThreadPoolExecutor

import pytest

from fastac.scenes import schema as scenes
from fastac.tune import page, run, space, tuning
from fastac.tune.groups import TuneError
from fastac.tune.trial import Source
from fastac.tune.tuning import OWN, Tuning

NAMES = list("abcdef")
BEST = 0.08


def found_of(scene, source, held_out):
    """A stand-in for trainings whose error is the distance from a noise, and larger on unit f."""
    settings = scene["training"]
    if settings["input_noise"] == 0.5:
        raise ValueError("such noise\ncannot be")
    error = 1 + abs(settings["input_noise"] - BEST) + 1e-3 * settings["seed"]
    if held_out is None:
        return {name: {"normal_mae_deg": error} for name in ("float", "integer")}
    return {name: {"normal_mae_deg": error * (2 if name == "f" else 1)} for name in held_out}


class NeverCurrent:
    def is_current(self, step):
        return False


@pytest.fixture
def tuned(tiny_scene, tiny_file, tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "perform", found_of)
    monkeypatch.setattr(tuning, "open_store", lambda path: NeverCurrent())

    def tune(axes, with_test=False, scene=tiny_scene, folds=None, **changes):
        points = space.candidates(scene, axes, 9, seed=1)
        source = Source(tiny_file, tmp_path, None, with_test)
        folds = folds or [[name] for name in NAMES]
        with ThreadPoolExecutor(2) as executor:
            return Tuning(points, folds, source, 2, executor, False, **changes).run()

    return tune


AXES = {"training.input_noise": [0.02, 0.04, BEST, 0.16, 0.5]}


def test_the_best_wins(tuned, tmp_path):
    content = json.loads(json.dumps(tuned(AXES)))
    winner = content["candidates"][content["winner"]]
    assert winner == {"training.input_noise": BEST}
    assert content["chosen_by_outer_fold"] == [content["winner"]] * 6
    assert content["indistinguishable"] == [content["winner"]]
    assert list(content["refused"].values()) == ["such noise cannot be"]
    error = content["nested"]["chosen"]["normal_mae_deg"]
    assert error["mean"] == pytest.approx((5 + 2) / 6 * (1 + 1.5e-3))  # seeds 1 and 2
    assert error["spread"] == pytest.approx(7 / 6 * 5e-4 * 2**0.5)  # of a sample of two
    assert len(error["folds"]) == 6
    assert error["folds"][5] == pytest.approx(2 * error["folds"][0])
    assert [len(entries) for entries in content["test"].values()] == [2, 2]
    assert content["warnings"] == [
        "6 groups or presses are few: errors on other ones may differ much from these"
    ]
    text = "\n".join(table.text for table in page.tables(content))
    assert "winner" in text
    assert "such noise cannot be" in text
    file = run.write_scene(content, tmp_path / "won.toml")
    assert scenes.load(file).training.input_noise == BEST
    assert file.read_text().startswith(
        "# fastac tune, from scene tiny: input_noise 0.08\n# nested normals' error"
    )
    page.write(content, tmp_path / "tune.html")
    assert "training.input_noise" in (tmp_path / "tune.html").read_text()


def test_a_scene_alone_is_judged_and_compared_with_nothing(tuned, tmp_path, monkeypatch):
    def no_pairs(scene, source, held_out):
        assert held_out is None or len(held_out) == 1
        return found_of(scene, source, held_out)

    monkeypatch.setattr(tuning, "perform", no_pairs)
    content = json.loads(json.dumps(tuned({})))
    assert (content["winner"], content["rungs"]) == (OWN, [])
    assert content["nested"]["scene"] == content["nested"]["chosen"]
    assert "the scene itself" in "\n".join(table.text for table in page.tables(content))
    page.write(content, tmp_path / "tune.html")


def test_a_scene_that_nothing_beats_is_kept(tuned):
    content = tuned({"training.input_noise": [0.3, 0.4]})
    assert content["winner"] == OWN
    assert "input_noise" not in content["candidates"][OWN]


def test_presses_of_the_test_split_among_the_others(tuned):
    content = tuned(AXES, with_test=True)
    assert content["test"] == {}


def test_metrics(tuned):
    with pytest.raises(TuneError, match=r"no error 'force_mae_n' is known; there are normal_mae_deg$"):
        tuned(AXES, metrics=("force_mae_n",))


def test_an_error_that_some_presses_do_not_have(tuned, monkeypatch):
    """The depth of a contact that reaches beyond the photograph: the others of its fold count."""

    def no_depth_of_two(scene, source, held_out):
        found = found_of(scene, source, held_out)
        depth = {"contact_depth_mae_mm": 3.0}
        return {name: errors if name in ("a", "f") else errors | depth for name, errors in found.items()}

    monkeypatch.setattr(tuning, "perform", no_depth_of_two)
    folds = [["a", "b"], ["c", "d"], ["e", "f"]]
    content = tuned(AXES, folds=folds)
    assert content["metrics"] == ["normal_mae_deg", "contact_depth_mae_mm"]
    assert content["candidates"][content["winner"]] == {"training.input_noise": BEST}
    error = content["nested"]["chosen"]["contact_depth_mae_mm"]
    assert (error["mean"], error["folds"]) == (3.0, [3.0] * 3)
    with pytest.raises(
        TuneError, match=r": a, f: no error 'contact_depth_mae_mm' is known; there are normal"
    ):
        tuned(AXES, folds=[["b", "c"], ["a", "f"], ["d", "e"]])


def test_a_scene_that_cannot_be_trained(tuned, make_scene):
    with pytest.raises(TuneError, match=r"^such noise cannot be$"):
        tuned(AXES, scene=make_scene(training={"input_noise": 0.5}))
