# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import signed
from amaranth.lib import data

from fastac.gateware.stream.tables import FIELD_BITS, RecordTable, packed_words, raster_beats
from fastac.sim.check_stream import pack


def test_words_of_a_table():
    table = np.random.default_rng(3).integers(-8, 8, (5, 5))
    words = raster_beats(table, 2)
    assert words.shape == (15, 2)
    assert raster_beats(np.ones((2, 5, 3)), 4).shape == (4, 4, 3)
    assert packed_words(words, 4) == pack(words, 4)


@pytest.mark.parametrize(("widths", "fields"), [((3, 29), 1), ((20, 13), 2), ((30, 30, 30), 4)])
def test_records_as_fields_of_an_image(widths, fields):
    """Cut into as few fields as an image allows, from the least significant bit on."""
    layout = data.StructLayout({f"part_{k}": signed(bits) for k, bits in enumerate(widths)})
    rng = np.random.default_rng(4)
    records = [
        {f"part_{k}": int(rng.integers(-(1 << (bits - 1)), 1 << (bits - 1))) for k, bits in enumerate(widths)}
        for _ in range(5)
    ]
    table = RecordTable(layout, records)
    form, values = table.format, table.values
    assert (form.depth, form.fields) == (5, fields) == values.shape
    assert form.bits <= FIELD_BITS
    assert np.abs(values).max() <= 1 << (form.bits - 1)
    for record, word in zip(records, pack(values, form.bits), strict=True):
        view = layout.from_bits(word & ((1 << layout.size) - 1))
        assert {name: view[name] for name in record} == record
