import pytest

from fastac.store.kinds import Kinds, UnknownKindError
from fastac.store.recording import recording

COLOURS = Kinds("colour", {"red": 1, "green": 2})
TABLE = f"{__name__}:colour"


def test_an_unknown_name():
    with pytest.raises(UnknownKindError) as caught:
        COLOURS["blue"]
    assert str(caught.value) == "colour: 'blue' is unknown; there is red, green"
    assert COLOURS.get("blue", 3) == 3
    with pytest.raises(TypeError):
        COLOURS["blue"] = 3


@pytest.mark.parametrize(
    ("use", "entries", "names"),
    [
        (lambda: COLOURS["red"], {"red"}, False),
        (lambda: COLOURS.get("green"), {"green"}, False),
        (lambda: COLOURS.get("blue"), set(), True),
        (lambda: "red" in COLOURS, set(), True),
        (lambda: list(COLOURS), set(), True),
        (lambda: len(COLOURS), set(), True),
        (lambda: list(COLOURS.items()), {"red", "green"}, True),
        (lambda: list(COLOURS.values()), {"red", "green"}, True),
    ],
)
def test_what_is_recorded(use, entries, names):
    with recording() as record:
        use()
    assert record.entries.get(TABLE, set()) == entries
    assert (TABLE in record.names) == names


def test_inner_recordings_are_part_of_outer_ones():
    with recording() as outer:
        with recording() as inner:
            COLOURS["red"]
        COLOURS["green"]
    assert inner.entries == {TABLE: {"red"}}
    assert outer.entries == {TABLE: {"red", "green"}}
