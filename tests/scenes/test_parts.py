import pytest
from pydantic import ValidationError

from fastac.scenes.parts import DEFAULT_PART, PARTS, meant
from fastac.scenes.schema import SceneError, parse

SCENE = """
name = "a"
outputs = ["normals"]
[sensor]
geometry = "flat"
height_px = 16
width_px = 16
channels = "bgr"
[hardware]
"""


def scene(hardware: str):
    return parse(SCENE + hardware, origin="scene.toml")


def refused(hardware: str) -> str:
    with pytest.raises(SceneError) as error:
        scene(hardware)
    text = str(error.value)
    assert "\n" not in text
    return text


def test_the_default_is_the_papers_part():
    assert scene("").hardware.part == DEFAULT_PART == PARTS.names[0]
    for part in PARTS:
        assert scene(f'part = "{part}"').hardware.part == part


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("xck26", "xck26-sfvc784-2LV-c"),
        ("XCK26-SFVC784-2LV-C", "xck26-sfvc784-2LV-c"),
        ("xc7z020-clg400-1", "xc7z020clg400-1"),
        ("kv260", "xck26-sfvc784-2LV-c"),
        ("ZCU104", "xczu7ev-ffvc1156-2-e"),
        ("pynq_z2", "xc7z020clg400-1"),
        ("arty-z7", "xc7z020clg400-1"),
        ("", None),
        ("ep4ce22", None),
    ],
)
def test_an_unknown_part_is_told_which_may_be_meant(name, part):
    assert meant(name) == part
    found = refused(f'part = "{name}"')
    assert found.startswith(
        f"scene.toml: hardware.part = {name!r}: Input should be 'xczu19eg-ffvc1760-2-i', "
    )
    assert found.endswith(f"; did you mean {part}?") == (part is not None)


@pytest.mark.parametrize("part", PARTS)
def test_the_clock_is_at_most_what_slices_and_memories_reach(part):
    facts = PARTS[part]
    largest = min(facts.dsp_mhz, facts.block_ram_mhz)
    given = f'part = "{part}"\nclock_mhz = '
    assert scene(f"{given}{largest}").hardware.clock_mhz == largest
    assert refused(f"{given}{largest + 0.1}") == (
        f"scene.toml: hardware.clock_mhz = {largest + 0.1:g}: the {part} reaches at most {largest:g} MHz (DSP"
        f" slices {facts.dsp_mhz:g}, block RAM {facts.block_ram_mhz:g}; AMD {facts.source})"
    )


def test_a_clock_is_positive():
    assert "hardware.clock_mhz = 0: Input should be greater than 0" in refused("clock_mhz = 0")


def test_a_part_is_a_name():
    with pytest.raises(ValidationError):
        scene("").hardware.model_validate({"part": 7})
