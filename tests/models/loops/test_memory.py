import numpy as np
import pytest
from numba import njit

from fastac.models.loops.memory import LINE_BYTES, aligned, aligned_zeros


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.uint8])
@pytest.mark.parametrize("shape", [(3,), (5, 7), (2, 3, 4)])
def test_a_copy_begins_at_a_line(kind, shape):
    array = np.arange(np.prod(shape)).reshape(shape).astype(kind)
    found = aligned(np.asfortranarray(array))
    assert found.ctypes.data % LINE_BYTES == 0
    assert found.flags.c_contiguous
    assert found.dtype == kind
    np.testing.assert_array_equal(found, array)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_compiled_zeros_begin_at_a_line(kind):
    @njit
    def made(like):
        zeros = [aligned_zeros(3, 5, like) for _ in range(8)]
        return [each.ctypes.data for each in zeros], zeros

    places, zeros = made(np.zeros(1, kind))
    assert not any(place % LINE_BYTES for place in places)
    for each in zeros:
        np.testing.assert_array_equal(each, np.zeros((3, 5), kind))
