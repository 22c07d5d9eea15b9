import numpy as np
import pytest

from fastac.sensor.optics.raw10 import Raw10Error, pack, unpack


def test_order_of_bits():
    """Pixel 0's high bits come first; its low bits are the lowest of the fifth byte."""
    assert pack(np.array([[1, 2, 3, 0]], np.uint16)).tolist() == [[0, 0, 0, 0, 0b00_11_10_01]]
    assert pack(np.array([[0x3FC, 0x200, 4, 8]], np.uint16)).tolist() == [[255, 128, 1, 2, 0]]


def test_every_value_survives():
    raw = np.random.default_rng(0).permutation(1024).astype(np.uint16).reshape(16, 64)
    packed = pack(raw)
    assert packed.shape == (16, 80)
    for data in (packed, packed.ravel(), packed.tobytes(), bytearray(packed.tobytes())):
        unpacked = unpack(data, 16, 64)
        assert unpacked.dtype == np.uint16
        np.testing.assert_array_equal(unpacked, raw)


def test_packs_many_images_at_once():
    raw = np.arange(3 * 4 * 8, dtype=np.uint16).reshape(3, 4, 8)
    np.testing.assert_array_equal(pack(raw)[1], pack(raw[1]))


@pytest.mark.parametrize(
    ("data", "size", "message"),
    [
        (bytes(19), (4, 4), "19 bytes: truncated, expected 20 for 4 x 4 px"),
        (bytes(21), (4, 4), "21 bytes: too long, expected 20"),
        (bytes(20), (4, 6), "width = 6 px: expected a multiple of 4"),
        (np.zeros(20, np.uint16), (4, 4), "data are uint16: expected uint8"),
    ],
)
def test_refuses_what_is_no_image(data, size, message):
    with pytest.raises(Raw10Error, match=message):
        unpack(data, *size)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (np.zeros((4, 4)), "float64: expected uint16"),
        (np.full((4, 4), 1024, np.uint16), "a pixel is 1024: expected at most 1023"),
        (np.zeros((4, 5), np.uint16), "width = 5 px"),
    ],
)
def test_refuses_to_pack_other_values(raw, message):
    with pytest.raises(Raw10Error, match=message):
        pack(raw)
