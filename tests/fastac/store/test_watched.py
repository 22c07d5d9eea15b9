import copy
import pickle
from functools import cache

import pytest
from pydantic import BaseModel, ValidationError


@pytest.fixture
def watch(toy):
    """A watched scene and the list of what it tells; paths alone for classes."""

    def make(**changes):
        told = []
        scene = toy.scene(**changes)
        return scene, scene.watched(lambda path, value: told.append((path, value))), told

    return make


def leaves(told) -> set[str]:
    return {path for path, value in told if not isinstance(value, type | dict) and not path.endswith("*")}


def classes(told) -> set[str]:
    return {value.__name__ for _, value in told if isinstance(value, type)}


NUMBERS = {"numbers.fraction_bits", "numbers.limit_bits", "numbers.weight_bits"}


def test_fields_and_rules(watch):
    scene, watched, told = watch()
    assert isinstance(watched, type(scene))
    assert isinstance(watched.numbers, type(scene.numbers))
    assert not leaves(told)
    assert watched.numbers.slope_bits == 16
    assert told[-1] == ("numbers.slope_bits", 16)
    assert watched.markers is None
    assert told[-1] == ("markers", None)
    assert leaves(told) == {"numbers.slope_bits", "markers"}
    assert not classes(told)


def test_that_a_table_is_there_is_told(watch):
    _, watched, told = watch(markers={})
    assert watched.markers
    assert told == [("markers", {"model": "Markers"})]
    assert watched.value_at("markers.spacing_mm") == 1.6


@pytest.mark.parametrize(
    "take", [BaseModel.model_dump, BaseModel.model_dump_json, repr, str, lambda s: s == 1, lambda s: s != 1]
)
def test_data_tells_all_fields(watch, take):
    scene, watched, told = watch()
    assert take(watched.numbers) == take(scene.numbers)
    assert leaves(told) == NUMBERS
    assert ("numbers.*", ("fraction_bits", "limit_bits", "weight_bits")) in told


@pytest.mark.parametrize(
    "take",
    [
        hash,
        copy.copy,
        copy.deepcopy,
        lambda s: pickle.loads(pickle.dumps(s)),
        lambda s: s.model_copy(update={"limit_bits": 3}),
        lambda s: s.total(),
        lambda s: vars(s),
        lambda s: list(type(s).model_fields),
    ],
)
def test_what_can_run_code_later_tells_the_class(watch, take):
    scene, watched, told = watch()
    found = take(watched.numbers)
    assert found == take(scene.numbers)
    assert type(found) is type(take(scene.numbers))
    assert leaves(told) == NUMBERS
    assert classes(told) == {"Numbers"}


def test_a_dump_with_nested_tables(watch):
    scene, watched, told = watch(markers={})
    assert watched.model_dump(exclude_unset=True) == {"markers": {}}
    assert {"name", "solver", "markers.spacing_mm", "model_fields_set", *NUMBERS} <= leaves(told)
    assert watched == scene
    assert scene == watched


def test_iteration_gives_watched_tables(watch):
    _, watched, told = watch()
    numbers = dict(iter(watched))["numbers"]
    told.clear()
    assert numbers.weight_bits == 8
    assert told == [("numbers.weight_bits", 8)]


def test_a_function_cached_by_a_scene_hides_nothing(watch):
    @cache
    def bits(scene):
        return scene.numbers.slope_bits

    _, first, _ = watch()
    _, second, told = watch()
    assert bits(first) == bits(second) == 16
    assert leaves(told) >= NUMBERS
    assert classes(told) == {"Scene", "Numbers"}


def test_validation_keeps_watching(watch):
    scene, watched, told = watch()

    class Holder(BaseModel):
        numbers: type(scene.numbers)

    assert type(scene).model_validate(watched) is watched
    held = Holder(numbers=watched.numbers)
    assert not leaves(told)
    assert held.numbers.limit_bits == 2
    assert leaves(told) == {"numbers.limit_bits"}
    assert held.model_dump() == {"numbers": scene.numbers.model_dump()}
    assert leaves(told) == NUMBERS


def test_watching_what_is_watched_tells_both(watch):
    scene, watched, outer = watch()
    inner = []
    again = watched.watched(lambda path, value: inner.append((path, value)))
    assert again.numbers.slope_bits == 16
    assert again.numbers.total() == 22
    assert leaves(outer) == leaves(inner) == {"numbers.slope_bits", *NUMBERS}
    assert again.unwatched() is scene


def test_a_rule_that_raises_tells_all(toy):
    toy.edit("schema.py", "return 2**self.weight_bits", "raise ValueError(self.weight_bits)")
    told = []
    watched = toy.scene().watched(lambda path, value: told.append((path, value)))
    with pytest.raises(ValueError, match="8"):
        _ = watched.numbers.weight_range
    assert leaves(told) == NUMBERS
    assert classes(told) == {"Numbers"}


def test_what_cannot_be_told_is_refused(watch):
    _, watched, _ = watch()
    with pytest.raises(ValidationError):
        watched.name = "other"
    with pytest.raises(TypeError, match="construct Numbers by its name"):
        type(watched.numbers)(limit_bits=3)
