"""The compiled pixel network against the integers' own layers and against NumPy in float64."""

import numpy as np
import pytest

from fastac.models.integer.features import integer_features
from fastac.models.integer.network import Requantisation
from fastac.models.loops.network import FrameNetwork
from fastac.models.loops.network_kernel import BLOCK, packed
from fastac.models.loops.vector_tile import NEURONS

SHAPES = [(1, 1, 3), (3, 5, 4), (8, BLOCK // 8, 3), (7, 37, 4)]
"""Images of less than one block of pixels, of one block, and of several blocks with the last incomplete."""


def frames_of(background: np.ndarray) -> list[np.ndarray]:
    rng = np.random.default_rng(2)
    noise = rng.integers(0, 256, background.shape, dtype=np.uint8)
    return [background, np.zeros_like(background), np.full_like(background, 255), noise]


def network(inputs: int, hidden: tuple[int, ...], weight_limit: int) -> list[np.ndarray]:
    """Tables (neurons, inputs + 1) of integers."""
    rng, tables = np.random.default_rng(1), []
    for neurons in (*hidden, 3):
        tables.append(rng.integers(-weight_limit, weight_limit + 1, (neurons, inputs + 1)))
        inputs = neurons
    return tables


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("hidden", [(16, 16, 16), (7, 5, 9), (21,), ()])
@pytest.mark.parametrize(("real", "weight_limit", "bits"), [(np.float32, 127, 10), (np.float64, 1 << 16, 12)])
def test_integers(shape, hidden, real, weight_limit, bits):
    """Sums within float32's exact integers, and of up to 32 bits; with zero and saturated activations."""
    rng = np.random.default_rng(3)
    background = rng.integers(0, 256, shape, dtype=np.uint8)
    tables, shift = network(shape[2] + 2, hidden, weight_limit), 20 if real == np.float32 else 30
    steps = [Requantisation(rng.integers(1, 1 << 12, n), shift, bits) for n in hidden]
    found = FrameNetwork(
        [*(table.astype(real) for table in tables[:-1]), tables[-1].astype(np.float64)],
        background,
        requantise=[(s.multiplier * 2.0**-s.shift, (1 << s.bits) - 1) for s in steps],
    )
    for frame in frames_of(background):
        x = integer_features(frame, background).reshape(-1, shape[2] + 2).astype(np.int64)
        for table, step in zip(tables, [*steps, lambda a: a], strict=True):
            x = step(x @ table[:, :-1].T + table[:, -1])
        np.testing.assert_array_equal(found(frame), x.T)


def test_products_next_to_an_integer():
    """Products of 22 by 17 bits, which float32 rounds: just below an integer, equal to it, and saturating."""
    rng = np.random.default_rng(4)
    multiplier, shift, top = (1 << 17) - 1, 30, 1023
    integers = rng.integers(1, 1 << 9, 1 << 12)
    below = (integers << shift) // multiplier
    sums = np.concatenate([below, below + 1, [0, -1, 1, (1 << 24) - 1, -(1 << 24) + 1]])
    step = Requantisation(np.array([multiplier] * len(sums)), shift, 10)
    expected = step(sums)
    assert (np.floor(sums.astype(np.float32) * np.float32(multiplier * 2.0**-shift)) != expected).any()
    # The sums are biases of neurons that see nothing; each of them is an output.
    background = np.zeros((1, 1, 3), np.uint8)
    first = np.zeros((len(sums), 6), np.float32)
    first[:, -1] = sums
    scale = np.full(len(sums), multiplier * 2.0**-shift)
    last = np.column_stack([np.eye(len(sums)), np.zeros(len(sums))])
    found = FrameNetwork([first, last], background, requantise=[(scale, top)])(background)
    np.testing.assert_array_equal(found[:, 0], expected)


@pytest.mark.parametrize("shape", SHAPES)
def test_floats(shape):
    background = np.random.default_rng(3).integers(0, 256, shape, dtype=np.uint8)
    tables = [table / 128 for table in network(shape[2] + 2, (16, 7), 127)]
    found = FrameNetwork([table.astype(np.float32) for table in tables], background)
    for frame in frames_of(background):
        x = integer_features(frame, background).reshape(-1, shape[2] + 2).astype(float)
        for k, table in enumerate(tables):
            x = x @ table[:, :-1].T + table[:, -1]
            x = np.maximum(x, 0) if k < len(tables) - 1 else x
        np.testing.assert_allclose(found(frame), x.T, rtol=1e-5, atol=1e-3)


def test_packed_tables_end_with_neurons_of_zeros():
    table = np.arange(1.0, 13).reshape(3, 4)
    (tile,) = packed(table, np.array([7.0, 8, 9]))
    assert tile.shape == (5, NEURONS)
    np.testing.assert_array_equal(tile[:, :3], np.vstack([table[:, 3], [7, 8, 9], table[:, :3].T]))
    assert not tile[:, 3:].any()
