# amaranth: UnusedElaboratable=no
import json

import numpy as np
import pytest

from fastac.gateware.bus.calibration_loader import CalibrationLoader, ImageLayout
from fastac.gateware.stream.tables import TableFormat
from fastac.sim.check_stream import pack
from fastac.sim.runner import simulate

LAYOUTS = {
    "tables of one and of four": ImageLayout(
        0x89ABCDEF,
        {"rest": TableFormat(depth=5, fields=1, bits=32), "offset": TableFormat(depth=3, fields=4, bits=11)},
        {"network": 45, "constant": 30},
    ),
    "a table of two": ImageLayout(0, {"offset": TableFormat(depth=6, fields=2, bits=20)}, {"network": 64}),
    "no table": ImageLayout(0xFFFFFFFF, {}, {"network": 1}),
}


def random_content(layout: ImageLayout, rng: np.random.Generator) -> tuple[dict, dict, int]:
    """Tables, registers and a hash: the extremes and anything between."""
    tables = {}
    for name, table in layout.tables.items():
        limit = 1 << (table.bits - 1)
        tables[name] = rng.integers(-limit, limit, (table.depth, table.fields))
        tables[name][0, 0], tables[name][-1, -1] = -limit, limit - 1
    registers = {
        name: int.from_bytes(rng.bytes(64), "little") % (1 << bits) for name, bits in layout.registers.items()
    }
    return tables, registers, int.from_bytes(rng.bytes(8), "little")


def settings(layout: ImageLayout, tables: dict, registers: dict, bundle_hash: int) -> dict:
    return {
        "words": layout.image(tables, registers, bundle_hash).tolist(),
        "hash": hex(bundle_hash),
        "registers": {name: hex(value) for name, value in registers.items()},
        "tables": {
            name: [hex(word) for word in pack(values, layout.tables[name].bits)]
            for name, values in tables.items()
        },
    }


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
@pytest.mark.quick("tables of one and of four", "no table")
def test_loader(tmp_path, layout):
    rng = np.random.default_rng(1)
    contents = [random_content(layout, rng) for _ in range(4)]
    _, registers, bundle_hash = contents[3]
    bench = {
        "images": [settings(layout, *content) for content in contents[:3]],
        "start": settings(layout, *contents[3]),
        "fields": {name: table.fields for name, table in layout.tables.items()},
    }
    path = tmp_path / "bench.json"
    path.write_text(json.dumps(bench))
    dut = CalibrationLoader(layout, registers, bundle_hash)
    simulate(dut, "calibration_loader", "fastac.sim.benches.calibration_loader", tmp_path, BENCH=str(path))


def test_words_of_an_image():
    layout = ImageLayout(7, {"offset": TableFormat(2, 2, 9)}, {"network": 40, "constant": 4})
    words = layout.image(
        {"offset": np.array([[1, -1], [-256, 255]])}, {"network": 0x12_89ABCDEF, "constant": 5}, 1 << 63
    )
    assert words.tolist() == [7, 1, 0xFFFFFFFF, 0xFFFFFF00, 255, 0x89ABCDEF, 0x512, 0, 1 << 31]
    assert words.dtype == np.uint32
    assert layout.words == len(words)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"identifier": 1 << 32}, "identifier 4294967296: expected 32 bits"),
        ({"registers": {}}, "registers {}: expected at least one"),
        ({"tables": {"rest": TableFormat(9, 1, 33)}}, "rest of 33 bits: expected 1 to 32"),
        (
            {"tables": {"rest": TableFormat(9, 3, 8)}},
            "rest of 9 words of 3: expected 2 or more of a power of two",
        ),
        ({"tables": {"rest": TableFormat(1, 1, 8)}}, "rest of 1 words of 1: expected 2 or more"),
    ],
)
def test_invalid_layouts(changed, message):
    with pytest.raises(ValueError, match=message):
        ImageLayout(**{"identifier": 1, "tables": {}, "registers": {"network": 3}, **changed})


@pytest.mark.parametrize(
    ("tables", "registers", "message"),
    [
        ({"rest": np.zeros((3, 2))}, {"network": 0}, r"rest \(3, 2\): expected \(4, 2\)"),
        ({"rest": np.full((4, 2), 8)}, {"network": 0}, "rest 8 to 8: expected -8 to 7"),
        ({"rest": np.zeros((4, 2))}, {"network": 8}, "network 0x8: expected 3 bits"),
    ],
)
def test_values_that_do_not_fit_the_layout(tables, registers, message):
    layout = ImageLayout(1, {"rest": TableFormat(4, 2, 4)}, {"network": 3})
    with pytest.raises(ValueError, match=message):
        layout.image(tables, registers, 0)
