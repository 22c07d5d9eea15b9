"""Compiled loops of the pixel network: a block of pixels passes all layers while it stays in the cache."""

import numpy as np

from fastac.models.loops.memory import aligned_zeros
from fastac.models.loops.vector_tile import NEURONS, PIXELS, tile_linear, tile_rectified, tile_requantised
from fastac.store.compiled_loops import compiled

BLOCK = 4 * PIXELS
"""Pixels per block: the activations of two layers of 16 neurons take 16 KiB in float32."""


def packed(table: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
    """Rearrange weights (neurons, inputs + 1), the bias last, into the tiles' layout (tiles, inputs + 2,
    NEURONS).

    A tile's rows are the biases, the scales (0 without), and the weights of each input; the last tile is
    padded with zero neurons.
    """
    neurons, columns = table.shape
    rows = np.zeros((columns + 1, -(-neurons // NEURONS) * NEURONS), table.dtype)
    rows[0, :neurons], rows[2:, :neurons] = table[:, -1], table[:, :-1].T
    if scale is not None:
        rows[1, :neurons] = scale
    return np.ascontiguousarray(rows.reshape(columns + 1, -1, NEURONS).transpose(1, 0, 2))


@compiled()
def _fill(frame, channels, rest, start, count, features):
    """Write the features (C + 2, BLOCK) of `count` pixels, beginning at `start`, into `features`; C is 3 or
    4."""
    seen = frame[start * channels :]
    # All channels in one loop, so that the compiler loads them together and sorts them in vectors.
    blue, green, red, near = features[0], features[1], features[2], features[3]
    b, g, r, n = rest[0, start:], rest[1, start:], rest[2, start:], rest[3, start:]
    if channels == 4:
        for p in range(count):
            blue[p] = np.float32(seen[4 * p]) - b[p]
            green[p] = np.float32(seen[4 * p + 1]) - g[p]
            red[p] = np.float32(seen[4 * p + 2]) - r[p]
            near[p] = np.float32(seen[4 * p + 3]) - n[p]
    else:
        for p in range(count):
            blue[p] = np.float32(seen[3 * p]) - b[p]
            green[p] = np.float32(seen[3 * p + 1]) - g[p]
            red[p] = np.float32(seen[3 * p + 2]) - r[p]
    for c in range(channels, len(rest)):
        plane, known = features[c], rest[c, start:]
        for p in range(count):
            plane[p] = known[p]


@compiled()
def _layer(table, inputs, neurons, x, y, top, requantised):
    """One hidden layer: inputs x (inputs, BLOCK) to activations y (neurons, BLOCK)."""
    for j in range(-(-neurons // NEURONS)):
        weights, real, source = table[j].ctypes.data, table[j, 0, 0], x[0, 0]
        for p in range(0, BLOCK, PIXELS):
            seen, found = x[0, p:].ctypes.data, y[j * NEURONS, p:].ctypes.data
            if requantised:
                tile_requantised(real, source, weights, inputs, seen, BLOCK, found, top)
            else:
                tile_rectified(real, source, weights, inputs, seen, BLOCK, found, top)


@compiled()
def _last_layer(table, inputs, x, y):
    for j in range(len(table)):
        weights, real, source = table[j].ctypes.data, table[j, 0, 0], x[0, 0]
        for p in range(0, BLOCK, PIXELS):
            seen, found = x[0, p:].ctypes.data, y[j * NEURONS, p:].ctypes.data
            tile_linear(real, source, weights, inputs, seen, BLOCK, found, real)


@compiled(inline="always")
def block_memory(rest, hidden, tops, last, out):
    """Scratch memory of one thread for `forward`: features, activations of two layers, outputs."""
    rows = hidden.shape[1] * NEURONS
    return (
        aligned_zeros(len(rest), BLOCK, tops),
        aligned_zeros(rows, BLOCK, tops),
        aligned_zeros(rows, BLOCK, tops),
        aligned_zeros(len(last) * NEURONS, BLOCK, out),
    )


@compiled()
def forward(frame, rest, hidden, neurons, tops, requantised, last, memory, start, stop, out):
    """Run the network on the pixels from `start` to before `stop` of one frame.

    frame : (pixels · C), bytes or int16, the C = 3 or 4 channels of a pixel side by side
    rest : (C + 2, pixels) float32, planes of the background's channels and of the two coordinate codes
    hidden : (layers, tiles, rows, NEURONS), each hidden layer's `packed` table, padded to a common shape
    neurons : (layers,) number of neurons of each hidden layer
    tops : (layers,) largest activation of each hidden layer, in the hidden layers' type
    requantised : whether activations are requantised as in `integer.network.Requantisation`, or only
        rectified
    last : the last layer's `packed` table
    memory : see `block_memory`
    out : (outputs, as many pixels or more), in the last layer's type
    """
    channels, pixels = len(rest) - 2, stop - start
    features, a, b, found = memory
    for first in range(0, pixels, BLOCK):
        count = min(BLOCK, pixels - first)
        _fill(frame, channels, rest, start + first, count, features)
        x, y, spare, inputs = features, a, b, len(rest)
        for k in range(len(hidden)):
            _layer(hidden[k], inputs, neurons[k], x, y, tops[k], requantised)
            x, y, spare, inputs = y, spare, y, neurons[k]
        _last_layer(last, inputs, x, found)
        for j in range(len(out)):
            place, row = out[j, first:], found[j]
            for p in range(count):
                place[p] = row[p]


@compiled()
def forward_whole(frame, rest, hidden, neurons, tops, requantised, last, out):
    """`forward` of all pixels of one frame."""
    memory = block_memory(rest, hidden, tops, last, out)
    forward(frame, rest, hidden, neurons, tops, requantised, last, memory, 0, out.shape[1], out)
