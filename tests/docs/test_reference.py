"""The reference of scene keys and registers says what schema and register map say."""

import pytest
from pydantic import BaseModel

from fastac.gateware.bus.register_map import REGISTERS
from fastac.scenes.parts import PARTS
from fastac.scenes.schema import Scene
from fastac.scenes.solvers import SOLVERS
from fastac_docs.registers import meanings, register_id, registers
from fastac_docs.scene_keys import key_id, known_keys, scene_keys, unit_of


def row(text: str, anchor: str) -> str:
    (found,) = (line for line in text.splitlines() if f'<span id="{anchor}"></span>' in line)
    return found


@pytest.fixture(scope="module")
def keys() -> str:
    return scene_keys()


def test_every_key_is_in_the_page_once(keys):
    def leaves(model, path=""):
        for name, value in model:
            yield f"{path}{name}"
            if isinstance(value, BaseModel):
                yield from leaves(value, f"{path}{name}.")

    scene = Scene.model_validate({"name": "a", "outputs": ["depth"], "sensor": {"geometry": "flat"}})
    assert set(leaves(scene)) <= known_keys()
    for key in known_keys():
        assert keys.count(f'<span id="{key_id(key)}"></span>') == 1, key


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("sensor.height_px", ["`128`", "integer, 16 to 256, px"]),
        ("sensor.elastomer.poisson_ratio", ["`0.48`", "number > 0, < 0.5"]),
        ("sensor.electrons_per_dn", ["number > 0 |"]),
        ("numbers.rounding", ['`"nearest"`', '`"nearest"`, `"floor"`', "16/16/16: 3.6 → 8.5 µm"]),
        ("force.band_mm", ["not given", "number > 0, mm"]),
        ("sensor.markers", ["no table", "[`[sensor.markers]`](#key-sensor-markers)"]),
        ("sensor.geometry", ["needed"]),
        ("protocol.loads_n", ["`[0.5, 1, 1.5]`", "list of: number > 0, N"]),
        ("poisson.solver", [f'`"{name}"`' for name in SOLVERS]),
        ("hardware.part", [f'`"{name}"`' for name in PARTS]),
        ("force.dots", ["`false`", "`true`, `false`"]),
    ],
)
def test_a_key_has_default_values_unit_and_meaning(key, words, keys):
    found = row(keys, key_id(key))
    assert [word for word in words if word not in found] == []


def test_units():
    assert [unit_of(key) for key in ("a_mm", "a_px", "electrons_per_dn", "seed")] == ["mm", "px", "", ""]


def test_every_register_and_field_is_in_the_page():
    text = registers()
    for register in REGISTERS:
        section = text.partition(f"({register_id(register.name)})=")[2].partition("\n(register-")[0]
        assert f"Offset `0x{register.offset:02x}`" in section
        for field in register.fields:
            assert f"| `{field.name}` | `0x{((1 << field.width) - 1) << field.low:08x}` |" in section


def test_meanings_go_to_their_fields_and_nothing_is_lost():
    known = {register.name: meanings(register) for register in REGISTERS}
    fields, text = known["CONTROL"]
    assert text == ""
    assert fields["enable"] == "accept frames; 1 after reset"
    fields, text = known["ERRORS"]
    assert text == "sticky error flags"
    assert fields["line_long"] == fields["no_start"]
    assert fields["results_lost"] == "RESULTS_LOST has grown"
    assert known["CAPABILITIES"][0]["depth"] == "this output or function exists"
    assert known["FRAME_VALIDITY"][1].startswith("measures of the last result's frame")
    for register in REGISTERS:
        fields, text = known[register.name]
        words = " ".join([*fields.values(), text]).split()
        assert {word.strip(".;:") for word in register.meaning.split()} - {
            word.strip(".;:") for word in words
        } <= {
            *(part for name in fields for part in (name,)),
            *("line_…", "brightness_…", "others", "The"),
            *(f"{name}," for name in fields),
            "line_…,",
        }, register.name
