# amaranth: UnusedElaboratable=no
import numpy as np

from fastac.gateware.stream.tables import RasterRom, raster_beats
from fastac.sim.check_stream import pack


def test_words_of_a_table():
    table = np.random.default_rng(3).integers(-8, 8, (5, 5))
    words = raster_beats(table, 2)
    assert words.shape == (15, 2)
    assert raster_beats(np.ones((2, 5, 3)), 4).shape == (4, 4, 3)
    assert RasterRom(words, 4).words == pack(words, 4)
