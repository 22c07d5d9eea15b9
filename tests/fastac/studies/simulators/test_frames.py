import numpy as np
import pytest
from PIL import Image

from fastac.studies.simulators.frames import chosen, photographs


def test_photographs_are_evenly_spread_and_keep_their_order_of_channels(tmp_path):
    (tmp_path / "press").mkdir()
    for k in range(5):
        pixels = np.full((40, 60, 3), (10 * k, 100, 200), np.uint8)  # red, green, blue
        Image.fromarray(pixels).save(tmp_path / "press" / f"{k}.png")
    found = photographs(tmp_path, (16, 16, 4), 3)
    assert found.shape == (3, 16, 16, 4)
    assert found[:, 5, 7].tolist() == [[200, 100, 10 * k, round((300 + 10 * k) / 3)] for k in (0, 2, 4)]
    with pytest.raises(FileNotFoundError, match=r"press/\*\.png: 5 photographs: expected 6 or more"):
        photographs(tmp_path, (16, 16, 3), 6)


def test_chosen_takes_turns():
    simulated = np.arange(10).reshape(10, 1, 1, 1)
    real = np.array([100, 101]).reshape(2, 1, 1, 1)
    assert chosen(simulated, 4, real).ravel().tolist() == [100, 0, 101, 3, 6, 9]
    assert chosen(simulated, 0, real).ravel().tolist() == [100, 101]
    assert chosen(simulated, 1, real[:0]).ravel().tolist() == [0]
