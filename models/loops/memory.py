"""Memory that begins at a cache line: vectors are loaded at once, and threads share no line that they
write."""

import numpy as np

from fastac.store.compiled_loops import compiled

LINE_BYTES = 64


def aligned(array: np.ndarray) -> np.ndarray:
    """A copy of an array at the beginning of a cache line, row after row."""
    memory = np.empty(array.nbytes + LINE_BYTES, np.uint8)
    first = -memory.ctypes.data % LINE_BYTES
    found = memory[first : first + array.nbytes].view(array.dtype).reshape(array.shape)
    found[...] = array
    return found


@compiled(inline="always")
def aligned_zeros(rows, columns, like):
    """Zeros (rows, columns) of the type of the array `like`, at the beginning of a cache line; compiled."""
    memory = np.zeros(rows * columns + LINE_BYTES // like.itemsize, like.dtype)
    first = -(memory.ctypes.data // like.itemsize) % (LINE_BYTES // like.itemsize)
    return memory[first : first + rows * columns].reshape(rows, columns)
